"""The steady states of a rotor, its voltages to avoid, and a speed reached by two plans."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ldt_core.advice.bands import voltage_bands
from ldt_core.advice.machine_estimate import MachineEstimate
from ldt_core.advice.run_up import RunUp
from ldt_core.base.arrays import Array
from ldt_core.base.sentences import listed, spoken
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.steady_state import steady_voltage
from ldt_core.views.page import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


HEIGHT = 6.2  # inches: as a picture of a run
POINTS = 4000  # of the curve, so that its folds are sharp
RAMP = 0.5  # share of the heedless run during which its voltage rises
PERIOD = 0.01  # s, of the runs' samples
STEADY = "Steady states"  # of a motor without an eccentric rotor


def plot_advice(
    machine: Machine, belief: MachineEstimate, way: RunUp, out: str | Path, seconds: float
) -> None:
    """Draw V over speed with its folds, and both runs over time.

    Args:
        belief: what the machine is taken to be.
        seconds: that the runs last.

    Raises:
        OptionError: another ending, or no such folder.
    """
    style.check_picture(out)

    def draw(figure: Figure) -> None:
        grid = figure.add_gridspec(2, 2, width_ratios=(1, 1.15), height_ratios=(1, 1.6))
        _curve(figure.add_subplot(grid[:, 0]), machine, belief, way)
        above = figure.add_subplot(grid[0, 1])
        _runs(above, figure.add_subplot(grid[1, 1], sharex=above), machine, belief, way, seconds)

    style.save_picture(style.picture(style.WIDE.width, HEIGHT, draw), out)


def heedless(way: RunUp, seconds: float) -> Array:
    """(L,) the voltage of somebody who raises it evenly to what holds the speed [V]."""
    time = np.arange(round(seconds / PERIOD)) * PERIOD
    return np.minimum(time / (RAMP * seconds), 1.0) * way.voltage


def _curve(axes: Axes, machine: Machine, belief: MachineEstimate, way: RunUp) -> None:
    limit, values = machine.voltage_limits[1], belief.values
    others = f", without {listed(map(spoken, belief.left_out))}" if belief.left_out else ""
    bands = voltage_bands(values, limit)
    speed = np.linspace(0.0, way.speed * 1.25, POINTS)
    volts = steady_voltage(values, speed)
    stable = np.gradient(volts) > 0
    axes.plot(volts, np.where(stable, speed, np.nan), color=style.INK, label=f"stable{others}")
    axes.plot(volts, np.where(stable, np.nan, speed), ":", color=style.INK, label="unstable")
    for i, band in enumerate(bands):
        label = "to avoid" if i == 0 else None
        axes.axvspan(band.low, band.high, color=style.ORANGE, alpha=0.22, lw=0, label=label)
        ends = [band.high, band.low], [band.held[1], band.free[0]]
        label = "fold: the speed jumps" if i == 0 else None
        axes.plot(*ends, "o", color=style.VERMILION, label=label)
    axes.plot(way.voltage, way.speed, "*", ms=11, color=style.BLUE, label="speed wanted")
    axes.set_xlabel("voltage held [V]")
    axes.set_ylabel("steady speed [rad/s]")
    axes.set_title(f"Steady states at e = {values['e'] * 1e3:.3g} mm" if "e" in values else STEADY)
    axes.set_xlim(0, max(volts.max(), way.through or 0) * 1.02)
    axes.set_ylim(0, speed[-1])
    axes.legend(loc="lower right")


def _runs(
    above: Axes,
    below: Axes,
    machine: Machine,
    belief: MachineEstimate,
    way: RunUp,
    seconds: float,
) -> None:
    values = belief.values
    ramp = heedless(way, seconds)
    time = np.arange(ramp.size) * PERIOD
    start = machine.model.initial_state(values, 0.0)
    runs = (
        ("raised evenly", ramp, style.ORANGE, "--"),
        ("as advised", way.volts(ramp.size, PERIOD), style.BLUE, "-"),
    )
    for label, volts, color, line in runs:
        speed = machine.model.simulate(values, volts, PERIOD, start, belief.beside)[:, 1]
        above.plot(time, volts, line, color=color, label=label, drawstyle="steps-post")
        below.plot(time, speed, line, color=color, label=label)
    below.axhline(way.speed, color=style.GREY, lw=0.8, ls=":")
    for i, band in enumerate(voltage_bands(values, machine.voltage_limits[1])):
        name = "held by the foundation" if i == 0 else None
        below.axhspan(band.held[0], band.free[0], color=style.ORANGE, alpha=0.22, lw=0, label=name)
    above.set_ylabel("voltage [V]")
    above.set_title("The same speed, by two plans (simulated)")
    above.legend(loc="lower right")
    above.tick_params(labelbottom=False)
    below.set_ylabel("speed [rad/s]")
    below.set_xlabel("time [s]")
    below.set_xlim(0, seconds)
    below.set_ylim(bottom=0)
    below.legend(loc="lower right")
