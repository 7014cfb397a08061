"""The rotor at constant speed: what the foundation takes, and where the speed must jump.

At constant speed the unbalance shakes the foundation as a turning force; the power that its dampers
take comes from the shaft. T_e(omega; e) below is that mean torque, V(omega) the voltage that holds
a speed. Where V falls with the speed no steady running is stable: at the folds dV/domega = 0 the
speed jumps to the other branch (Sommerfeld effect; V. O. Kononenko, "Vibrating Systems with a
Limited Power Supply", 1969).
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from ldt_core.base.arrays import Array
from ldt_core.physics.parameter import Values

GRID = 20_000  # speeds at which the sign of dV/domega is looked at, before each fold is polished
FINE_GRID = 1000  # the same between two of these where two folds lie
DERIVATIVE_STEP = 1e-6  # of the speed, for dV/domega: a central difference is good to 1e-10


class Fold(NamedTuple):
    """A point where the speed jumps."""

    speed: float  # rad/s
    voltage: float  # V
    rising: bool  # V has a maximum: reached by rising voltage; else by falling


def has_foundation(values: Values) -> bool:
    """Whether the machine is one that can be captured, were it out of balance."""
    return all(name in values for name in ("e", "m", "M", "K_x", "K_y", "R_x", "R_y"))


def unbalance_torque(values: Values, speed: ArrayLike) -> Array:
    """Mean torque T_e that the foundation takes at constant speed [N m].

    sum over x, y of (m e)^2 w^5 R / (2 [(K - (M+m) w^2)^2 + (w R)^2]); 0 without a foundation.
    """
    w = np.asarray(speed, dtype=np.float64)
    if not has_foundation(values):
        return np.zeros_like(w)
    mass = values["M"] + values["m"]
    total = np.zeros_like(w)
    for axis in "xy":
        k, r = values[f"K_{axis}"], values[f"R_{axis}"]
        distance = (k - mass * w**2) ** 2 + (w * r) ** 2
        total = total + (values["m"] * values["e"]) ** 2 * w**5 * r / (2 * distance)
    return total


def steady_voltage(values: Values, speed: ArrayLike) -> Array:
    """Voltage that holds a speed: (R / K_t) (T_e + b w) + K_t w [V]."""
    w = np.asarray(speed, dtype=np.float64)
    torque = unbalance_torque(values, w) + values["b"] * w
    return values["R"] / values["K_t"] * torque + values["K_t"] * w


def folds(values: Values, highest: float) -> list[Fold]:
    """The folds below the speed `highest` [rad/s], in order of speed."""

    def slope(w: float | Array) -> Array:
        h = DERIVATIVE_STEP * w
        return (steady_voltage(values, w + h) - steady_voltage(values, w - h)) / (2 * h)

    def bracket(low: float, high: float, rises: bool) -> tuple[float, float] | None:
        if (slope(low) > 0) == rises != (slope(high) > 0):
            return low, high
        # The next fold is so near that it lies between them as well.
        fine = np.linspace(low, high, FINE_GRID)
        up = slope(fine) > 0
        at = np.flatnonzero((up[:-1] == rises) & (up[1:] != rises))
        return (fine[at[0]], fine[at[0] + 1]) if at.size else None

    grid = np.linspace(highest / GRID, highest, GRID)
    rising = np.diff(steady_voltage(values, grid)) > 0
    found = []
    for i in np.flatnonzero(rising[1:] != rising[:-1]):
        between = bracket(grid[i], grid[i + 2], bool(rising[i]))
        if between is not None:
            w = float(brentq(slope, *between))
            found.append(Fold(w, float(steady_voltage(values, w)), bool(rising[i])))
    return found


def bands(values: Values, highest: float) -> list[tuple[float, float]]:
    r"""The speeds of the Sommerfeld effect below `highest` [rad/s], one band a critical speed.

    Between a fold where V has a maximum and the following one where it has a minimum no speed is
    stable. Coming from below the rotor is captured well before: from the voltage of that minimum on
    there are two stable speeds, and which of them it takes depends on how it got there. So a band
    reaches from the lower of the two at that voltage to the end of the unstable branch:

        V
        |          o fold (captured until here, then a jump up)
        |        /   \
        |      /       \        /
        |    +  -  -  -  o     /        V of the minimum
        |  / |           | fold (coming down: a jump down)
        +----[===========]-------- speed

    Without folds (a small eccentricity, a machine without foundation) there is none. Where the
    minimum lies above `highest`, that speed ends the band. Bands that touch become one.
    """
    if not values.get("e"):
        return []
    found: list[tuple[float, float]] = []
    branch = 0.0  # speed at which the stable branch below the maximum begins
    turning = folds(values, highest)
    for top, bottom in itertools.zip_longest(turning[::2], turning[1::2]):
        end = highest if bottom is None else bottom.speed
        level = float(steady_voltage(values, end))
        low = branch
        if steady_voltage(values, branch) < level:
            low = float(
                brentq(lambda w, v=level: float(steady_voltage(values, w)) - v, branch, top.speed)
            )
        if found and low <= found[-1][1]:
            low = found.pop()[0]
        found.append((low, end))
        branch = end
    return found
