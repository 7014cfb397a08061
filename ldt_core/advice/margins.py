"""What is left to the limits of a machine, and to the eccentricity that it can bear."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from ldt_core.physics.steady_state import has_foundation, unbalance_torque

Values = Mapping[str, float]
Array = NDArray[np.float64]

GRID = 4_000  # speeds among which the turning points are looked for, before each is polished


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
