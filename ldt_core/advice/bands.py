"""Voltages at which an unbalanced rotor has two steady speeds, and may be captured at the lower.

The voltage that holds a speed, V(omega), is an explicit function (`physics/steady_state.py`). Where
it has a maximum and then a minimum, every voltage between the two holds two stable speeds: one on
the branch below the critical speed, where the motor's power goes into the foundation, and one
beyond. A rotor that comes from below with such a voltage stays on the lower branch, if it does not
get past the critical speed before the foundation has built up its motion, which takes seconds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.optimize import brentq, minimize_scalar

from ldt_core.base.arrays import Array
from ldt_core.physics.parameter import Values
from ldt_core.physics.steady_state import folds, has_foundation, steady_voltage, unbalance_torque

if TYPE_CHECKING:
    from ldt_core.base.experiment import Experiment

#: How well e is known, relative: a voltage that an e within it puts into a band counts as in it.
E_UNCERTAINTY = 0.05

GRID = 4_000  # speeds among which the turning points are looked for, before each is polished


@dataclass(frozen=True)
class CaptureBand:
    """Voltages between two folds; all for one sense of rotation, the other is its mirror image.

    Args:
        low: at the minimum of V(omega): coming down, the speed drops here [V].
        high: at its maximum: coming up, the speed jumps here [V].
        held: stable speeds below the critical one, at `low` and at `high` [rad/s].
        free: stable speeds beyond it, at `low` and at `high` [rad/s].
    """

    low: float
    high: float
    held: tuple[float, float]
    free: tuple[float, float]


def voltage_bands(values: Values, highest: float) -> list[CaptureBand]:
    """The bands that begin below a voltage, in their order.

    Args:
        highest: [V], above 0.

    Returns:
        None for a machine without foundation or with a small e. A band may end above `highest`:
        then no voltage up to it brings the rotor past that critical speed.
    """
    if not has_foundation(values) or not values["e"]:
        return []
    # No steady speed at a voltage is above that without any load.
    turning = folds(values, highest / values["K_t"])
    found = []
    begin = 0.0
    for top, bottom in itertools.pairwise(turning):
        if not top.rising:
            continue
        if bottom.voltage < highest:
            after = [f.speed for f in turning if f.speed > bottom.speed]
            end = after[0] if after else top.voltage / values["K_t"]
            held = _speed(values, bottom.voltage, begin, top.speed), top.speed
            free = bottom.speed, _speed(values, top.voltage, bottom.speed, end)
            found.append(CaptureBand(bottom.voltage, top.voltage, held, free))
        begin = bottom.speed
    return found


def _speed(values: Values, voltage: float, low: float, high: float) -> float:
    """The speed of a rising branch at a voltage, held at the branch's ends [rad/s]."""

    def excess(speed: float) -> float:
        return float(steady_voltage(values, speed)) - voltage

    if excess(low) >= 0:
        return low
    return high if excess(high) <= 0 else float(brentq(excess, low, high))


def any_eccentricity(values: Values) -> list[Values]:
    """The same parameters with e as it is, and at either end of its uncertainty."""
    return [{**values, "e": values["e"] * f} for f in (1.0, 1 + E_UNCERTAINTY, 1 - E_UNCERTAINTY)]


def uncertain_bands(values: Values, highest: float) -> list[tuple[float, float]]:
    """Voltages of all bands, for any e within `E_UNCERTAINTY`, joined where they touch.

    Args:
        highest: the machine's limit [V]; nothing reaches beyond.
    """
    if not values.get("e"):
        return []
    found = sorted(
        (b.low, min(b.high, highest))
        for believed in any_eccentricity(values)
        for b in voltage_bands(believed, highest)
    )
    joined: list[tuple[float, float]] = []
    for low, high in found:
        if joined and low <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(joined[-1][1], high)
        else:
            joined.append((low, high))
    return joined


def in_bands(voltage: Array, stretches: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    """(L,) whether each voltage [V], of either sign, lies in one of the stretches."""
    size = np.abs(voltage)
    inside = np.zeros(size.shape, dtype=np.bool_)
    for low, high in stretches:
        inside |= (low <= size) & (size <= high)
    return inside


def captured_seconds(values: Values, bands: Sequence[CaptureBand], experiment: Experiment) -> float:
    """Seconds that an experiment spent captured.

    That is, at speeds below the end of a band's unstable branch while the voltage would hold a
    faster one, in stretches longer than the foundation takes to build up its motion: passing
    through is no capture. The speed is averaged over that time, since the captured rotor's beats.
    """
    total = 0.0
    patience = build_up_time(values)
    window = max(round(min(patience, experiment.duration) / experiment.period), 1)
    size, speed = np.abs(experiment.voltage), np.abs(experiment.speed)
    speed = uniform_filter1d(speed, window, mode="nearest")
    for band in bands:
        there = (size >= band.low) & (band.held[0] <= speed) & (speed < band.free[0])
        edges = np.flatnonzero(np.diff(np.concatenate([[0], there.astype(np.int8), [0]])))
        lengths = (edges[1::2] - edges[::2]) * experiment.period
        total += float(lengths[lengths > patience].sum())
    return total


def build_up_time(values: Values) -> float:
    """Seconds in which the faster of the foundation's two motions builds up to 1 - 1/e."""
    mass, most = values["m"] + values["M"], max(values["R_x"], values["R_y"])
    return 2 * mass / most if most else math.inf


@dataclass(frozen=True)
class Margins:
    """Eccentricities at which a rotor's running changes; None where none does it.

    Args:
        first_fold: from it on there is a band, and the rotor can be captured [m].
        no_way_through: from it on the highest voltage holds it below a critical speed [m].
    """

    first_fold: float | None
    no_way_through: float | None


def margins(values: Values, highest: float) -> Margins:
    """What the eccentricity may become, all other parameters as they are.

    With V(omega; e) = V_0(omega) + e^2 g(omega), both follow without a search over e:

    - dV/domega = 0 has a solution where e^2 >= V_0' / (-g'), so from the least of these on;
    - a maximum of V touches the limit where (limit - V_0) / g has a local minimum, which is e^2.

    Args:
        values: the machine's parameters; their e does not matter.
        highest: the machine's limit [V], above 0.
    """
    if not has_foundation(values):
        return Margins(None, None)
    unit = {**values, "e": 1.0}
    slope = values["R"] * values["b"] / values["K_t"] + values["K_t"]
    end = highest / slope  # a faster ideal rotor is beyond the limit
    speeds = np.linspace(end / GRID, end, GRID)

    def g(speed: Array | float) -> Array:
        return values["R"] / values["K_t"] * unbalance_torque(unit, speed)

    def steepness(speed: float) -> float:
        h = 1e-6 * speed
        return float(g(speed + h) - g(speed - h)) / (2 * h)

    def at_limit(speed: float) -> float:
        return math.log(max(highest - slope * speed, 1e-300) / float(g(speed)))

    with np.errstate(divide="ignore"):
        falls = np.gradient(g(speeds), speeds)
        room = (highest - slope * speeds) / g(speeds)
    steepest = int(np.argmin(falls))
    first = None
    if falls[steepest] < 0:
        at = _least(steepness, speeds, steepest)
        first = math.sqrt(slope / -steepness(at))
    minima = np.flatnonzero((room[1:-1] < room[:-2]) & (room[1:-1] < room[2:])) + 1
    touching = [math.exp(at_limit(_least(at_limit, speeds, int(i))) / 2) for i in minima]
    return Margins(first, min(touching, default=None))


def _least(function: object, grid: Array, index: int) -> float:
    """The minimum of a function next to a grid's own."""
    low, high = grid[max(index - 1, 0)], grid[min(index + 1, grid.size - 1)]
    found = minimize_scalar(
        function, bounds=(low, high), method="bounded", options={"xatol": 1e-9 * high}
    )
    return float(found.x)
