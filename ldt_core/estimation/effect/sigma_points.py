"""What is not known for sure, as a few machines that may be the real one.

A linearisation would not do: near the edge of capture 1 % more unbalance decides whether the rotor
is caught. So the posterior is represented by sigma points (Julier and Uhlmann, "Unscented filtering
and nonlinear estimation", Proc. IEEE 92, 2004), each placed where the loss itself, not its second
derivative, says that its distance is sqrt(3) deviations.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ldt_core.estimation.effect.cause import Array
from ldt_core.estimation.effect.joint_fit import JointFit, Minimum
from ldt_core.estimation.effect.start_angle import AngleBelief

RISE = 3.0  # squared deviations at a sigma point: two a direction then have a normal's moments
ANGLE_OUTLIER = 5.0  # deviations from the common start angle: one further off was no start of it
RISE_TOLERANCE = 2.0  # factor by which the rise may miss `RISE`: the spread is good to a half
CORRECTIONS = 4  # of a sigma point's distance: two are usual


@dataclass(frozen=True, eq=False)
class SigmaPoint:
    """A machine that may be the real one.

    Args:
        weight: its probability.
        z: (d,) the effect's coordinates.
        angle: start angle [rad].
    """

    weight: float
    z: Array
    angle: float


def sigma_points(
    descent: JointFit, minimum: Minimum, belief: AngleBelief, spread: bool
) -> list[SigmaPoint]:
    """The best estimate and sigma points about it.

    Args:
        descent: the fit.
        minimum: where it ended.
        belief: about the start angle.
        spread: False leaves it at the best estimate.
    """
    d = len(descent.cause.names)
    places, angle = list(range(d)), belief.angle or 0.0
    one = descent.angle(0) if descent.shared or len(descent.seen) == 1 else None
    if one is not None and _likely(float(minimum.q[one]), descent, belief):
        places.append(one)
        angle = float(minimum.q[one])
    best = SigmaPoint(1.0, minimum.q[:d], angle)
    if not spread:
        return [best]
    at = np.array(places)
    covariance = minimum.covariance[np.ix_(at, at)]
    deviations = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(deviations, deviations))
    axes = (vectors * np.sqrt(np.maximum(values, 0.0))).T * deviations
    follow = minimum.covariance[:, at] @ np.linalg.inv(covariance)
    count = len(places)
    distance = math.sqrt(max(RISE, float(count)))
    weight = 1 / (2 * distance**2)
    members = [SigmaPoint(1.0 - 2 * count * weight, best.z, best.angle)]
    for axis in axes:
        for sign in (1.0, -1.0):
            move = _moved(descent, minimum, follow @ (sign * distance * axis))
            q = np.clip((minimum.q + move)[:d], descent.cause.low, descent.cause.high)
            turned = angle + float(move[one]) if one is not None and len(at) > d else angle
            members.append(SigmaPoint(weight, q, turned))
    return members


def _likely(angle: float, descent: JointFit, belief: AngleBelief) -> bool:
    """Whether the next experiment may start where this one did."""
    if not descent.seen[0].start.rest:
        return False
    if belief.angle is None or belief.same < 0.5:
        return True
    turn = descent.cause.turn
    off = (angle - belief.angle + turn / 2) % turn - turn / 2
    return abs(off) < ANGLE_OUTLIER * belief.std


def _moved(descent: JointFit, minimum: Minimum, move: Array) -> Array:
    """The move along this direction at which the loss has risen by RISE."""
    d = len(descent.cause.names)
    least = descent.loss(minimum.q, minimum)
    most = math.sqrt(RISE) * descent.spread
    for _ in range(CORRECTIONS):
        move = move / max(1.0, float(np.max(np.abs(move) / most)))
        q = minimum.q + move
        q[:d] = np.clip(q[:d], descent.cause.low, descent.cause.high)
        rise = descent.loss(q, minimum) - least
        if RISE / RISE_TOLERANCE <= rise <= RISE * RISE_TOLERANCE:
            break
        factor = math.sqrt(RISE / rise) if rise > 0 else 2.0
        move = move * min(max(factor, 0.1), 2.0)
    return move
