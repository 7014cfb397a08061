"""How to come to a speed that lies past voltages at which the rotor may be captured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ldt_core.advice.bands import (
    any_eccentricity,
    build_up_time,
    in_bands,
    uncertain_bands,
    voltage_bands,
)
from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError, OptionError
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.steady_state import steady_voltage

RUN_UP_VOLTAGES = 5  # voltages of a run-up that are tried, from just above the band to the limit
SPEED_TOLERANCE = 0.02  # of the speed: nearer, it has been reached
TRIAL_PERIOD = 0.02  # s, of the trials
LONGEST_RUN_UP = 20.0  # s, longest run-up
SETTLING_TIMES = 8.0  # build-up times of the foundation after which a kept speed is final


@dataclass(frozen=True)
class RunUp:
    """A way to a speed from rest.

    Args:
        speed: to be reached [rad/s].
        voltage: that holds it [V].
        through: voltage to begin with [V]; None where `voltage` may be set at once.
        seconds: for which `through` is held [s].
    """

    speed: float
    voltage: float
    through: float | None = None
    seconds: float = 0.0

    def volts(self, samples: int, period: float) -> Array:
        """(samples,) the voltage over time, each held for a period [s]."""
        first = self.voltage if self.through is None else self.through
        early = np.arange(samples) * period < self.seconds - period / 2
        return np.where(early, first, self.voltage)

    def describe(self) -> str:
        """In words."""
        if self.through is None:
            return f"Set {self.voltage:.3g} V for {self.speed:.3g} rad/s."
        return (
            f"To run at {self.speed:.3g} rad/s, hold {self.through:.3g} V for "
            f"{self.seconds:.2g} s from rest, then {self.voltage:.3g} V: from below, that voltage "
            "alone may leave the rotor captured."
        )


def plan_run_up(machine: Machine, values: Mapping[str, float], speed: float) -> RunUp:
    """A way to hold a speed that does not end in capture, tried in simulation.

    Past a band the lowest voltage is taken that comes through with e larger or smaller by the
    uncertainty there is about it (`bands.E_UNCERTAINTY`).

    Args:
        speed: [rad/s], above 0.

    Raises:
        OptionError: a speed that no voltage within the limits holds stably, or to which no voltage
            leads past the resonance.
    """
    limit = machine.voltage_limits[1]
    if not 0 < speed < math.inf:
        raise OptionError("--reach", "a finite speed above 0 rad/s", f"{speed:g}")
    voltage = values["K_t"] * speed  # against no torque at all
    if voltage <= limit:
        voltage = float(steady_voltage(values, speed))
    if voltage > limit:
        got = f"{speed:g}, which takes {voltage:.3g} V or more"
        raise OptionError("--reach", f"a speed that {limit:g} V can hold", got)
    bands = voltage_bands(values, limit)
    for band in bands:
        if band.held[0] <= speed <= band.free[0]:
            beside = f"below {band.held[0]:.3g} or above {band.free[0]:.3g} rad/s"
            got = f"{speed:g}, where the foundation takes the motor's power"
            raise OptionError("--reach", beside, got)
    doubtful = [s for s in uncertain_bands(values, limit) if in_bands(np.array([voltage]), [s])[0]]
    if not doubtful:
        return RunUp(speed, voltage)
    edge = doubtful[-1][1]
    for through in np.linspace(edge, limit, RUN_UP_VOLTAGES + 1)[1:] if edge < limit else ():
        run_up = _tried(machine, values, speed, voltage, float(through))
        if run_up is not None:
            return run_up
    got = f"{speed:g}, beyond a resonance"
    raise OptionError("--reach", f"a speed to which {limit:g} V lead for certain", got)


def _tried(
    machine: Machine, values: Mapping[str, float], speed: float, voltage: float, through: float
) -> RunUp | None:
    """The way by this run-up voltage, if it ends at the speed whatever e is."""
    spread = any_eccentricity(values)
    held = np.full(round(LONGEST_RUN_UP / TRIAL_PERIOD), through)
    needed = 0.0
    for believed in spread:
        there = np.flatnonzero(_run(machine, believed, held) >= speed)
        if not there.size:
            return None
        needed = max(needed, float(there[0]) * TRIAL_PERIOD)
    run_up = RunUp(speed, voltage, through, needed)
    rest = SETTLING_TIMES * build_up_time(values)
    samples = round((needed + rest) / TRIAL_PERIOD)
    for believed in spread:
        end = _run(machine, believed, run_up.volts(samples, TRIAL_PERIOD))[
            -round(1 / TRIAL_PERIOD) :
        ]
        holds = float(steady_voltage(believed, speed))
        # What another e does to the speed at this voltage is no capture.
        allowed = SPEED_TOLERANCE * speed + abs(holds - voltage) / values["K_t"]
        if abs(float(end.mean()) - speed) > allowed:
            return None
    return run_up


def _run(machine: Machine, values: Mapping[str, float], volts: Array) -> Array:
    """(L,) speed from rest [rad/s]; none where it diverges."""
    initial = machine.model.initial_state(values, 0.0)
    try:
        return np.asarray(machine.model.simulate(values, volts, TRIAL_PERIOD, initial)[:, 1])
    except LdtError:
        return np.zeros(volts.size)
