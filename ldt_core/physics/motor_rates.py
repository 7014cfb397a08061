"""How fast a motor is, electrically and as a whole.

A winding without inductance is taken as one with hardly any, since equations divide by it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

#: Of the time in which the motor forgets its speed, the least L/R that is told from none: it delays
#: the speed by a ten millionth of that time, far below any sensor's resolution.
LEAST_SHARE = 1e-7


def memory(values: Mapping[str, float]) -> float:
    """Time constant with which the motor forgets its speed, its inductance left out [s]."""
    return values["R"] * values["J"] / (values["R"] * values["b"] + values["K_t"] ** 2)


def inductance(values: Mapping[str, float]) -> float:
    """The winding's inductance [H], which may be 0 in the machine file but not in a division."""
    return max(values["L"], LEAST_SHARE * values["R"] * memory(values))


def motor_rate(values: Mapping[str, float]) -> float:
    """Largest magnitude of the roots of the motor's characteristic polynomial [1/s]."""
    k, r, j, b = (values[n] for n in ("K_t", "R", "J", "b"))
    own = inductance(values)
    return fastest_root(r / own + b / j, (r * b + k * k) / (own * j))


def fastest_root(damping: float, stiffness: float) -> float:
    """Largest |s| with s^2 + damping s + stiffness = 0, for damping, stiffness >= 0 [1/s]."""
    under = damping * damping - 4 * stiffness
    return math.sqrt(stiffness) if under < 0 else (damping + math.sqrt(under)) / 2
