"""From experiments to a cause: which of them count, what they say together, how sure it is.

What is not known for sure is represented by a few machines that may be the real one. A
linearisation would not do: near the edge of capture 1 % more unbalance decides whether the rotor is
caught. So the posterior consists of sigma points (Julier and Uhlmann, "Unscented filtering and
nonlinear estimation", Proc. IEEE 92, 2004), each placed where the loss itself, not its second
derivative, says that its distance is sqrt(3) deviations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment, rms
from ldt_core.estimation.effect.cause import UncertainStart
from ldt_core.estimation.effect.global_search import EffectSearch
from ldt_core.estimation.effect.joint_fit import FittedExperiment, JointFit, Minimum
from ldt_core.estimation.effect.start_angle import AngleBelief, FoundAngle, believe, together
from ldt_core.physics.base import ANGLE

RISE = 3.0  # squared deviations at a sigma point: two a direction then have a normal's moments
ANGLE_OUTLIER = 5.0  # deviations from the common start angle: one further off was no start of it
RISE_TOLERANCE = 2.0  # factor by which the rise may miss `RISE`: the spread is good to a half
CORRECTIONS = 4  # of a sigma point's distance: two are usual
MOST_RATIO = 1.5  # of an older experiment's residual to the newest one's, for it to count as well
CONTRADICTION = 25.0  # squared deviations by which a common start angle may fit less well: 5 sigma
ANGLES_TRIED = 4  # in a turn, for the start of an older experiment; the descent finds the rest


@dataclass(frozen=True, eq=False)
class SigmaPoint:
    """A machine that may be the real one: probability, (d,) coordinates, start angle [rad]."""

    weight: float
    z: Array
    angle: float


def sigma_points(
    descent: JointFit, minimum: Minimum, belief: AngleBelief, spread: bool
) -> list[SigmaPoint]:
    """The best estimate at that minimum and, if `spread`, sigma points about it."""
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


@dataclass(frozen=True, eq=False)
class LearnedEffect:
    """What the experiments say.

    Attributes:
        z: (d,) the effect's coordinates.
        members: the same with what is uncertain about it; the best first.
        noise, memory: deviation of what is left [rad/s]; samples in which it forgets itself.
        angles, belief: start angles found so far; whether the machine always starts at the same.
        used: experiments that it is learned from.
    """

    z: Array
    members: list[SigmaPoint]
    noise: float
    memory: float
    angles: list[FoundAngle]
    belief: AngleBelief
    used: list[Experiment]


class EffectLearner:
    """Learns one cause from the same experiments, whole or with blocks held back.

    The newest experiment is the machine's present: the effect is searched for in that one alone. Of
    the older ones those join which the same machine can have made. `angles` are the start angles
    found in earlier experiments.
    """

    def __init__(
        self,
        search: EffectSearch,
        experiments: Sequence[Experiment],
        angles: Sequence[FoundAngle] = (),
    ) -> None:
        self.search, self.cause = search, search.cause
        self.experiments = list(experiments)
        self._angles = list(angles)
        best = search.best.q[: len(self.cause.names)]
        self._starts = [self._start(e, best) for e in experiments]
        self._used = [i for i, e in enumerate(experiments) if self._holds(e, self._starts[i])]
        numbers = {experiments[i].number for i in self._used}
        self._before = [a for a in angles if a.number not in numbers]

    def learn(self, held: Sequence[slice] | None = None) -> LearnedEffect:
        """The effect's parameters, and how sure they are.

        Of each experiment the samples `held` are not looked at; then the uncertainty is left out.
        """
        masks = [np.ones(len(e), dtype=bool) for e in self.experiments]
        for mask, block in zip(masks, held or [], strict=held is not None):
            mask[block] = False
        newest = next(i for i in self._used if self.experiments[i] is self.search.experiment)
        minimum = self.search.part(masks[newest])
        d = len(self.cause.names)
        seen = [
            FittedExperiment(self.experiments[i], self._starts[i], masks[i]) for i in self._used
        ]
        descent = self._descent(seen)
        if len(seen) > 1:
            z = minimum.q[:d]
            minimum = descent.run(descent.point(z, [self._turned(s, z) for s in seen]))
        belief, angles = self._weigh(descent, minimum)
        if belief.angle is not None and self._alike(belief, seen):
            known = believe(self._before, self.cause.turn) if self._before else None
            prior = (known.angle, known.std) if known and known.angle is not None else None
            alike = self._descent(seen, True, prior)
            same = alike.run(alike.point(self._z_at(descent, minimum, belief), [belief.angle]))
            # One angle for all must not cost what chance cannot explain.
            worse = sum(r.size for r in same.rests) * (same.rms**2 / minimum.rms**2 - 1)
            if worse < CONTRADICTION * minimum.memory:
                descent, minimum = alike, same
        members = sigma_points(descent, minimum, belief, held is None)
        used = [s.experiment for s in seen]
        return LearnedEffect(
            minimum.q[:d], members, minimum.rms, minimum.memory, angles, belief, used
        )

    def _start(self, e: Experiment, z: Array) -> UncertainStart:
        if e is self.search.experiment:
            return self.search.start
        return self.cause.start(e, self.search.noise, z)

    def _descent(
        self,
        seen: Sequence[FittedExperiment],
        same: bool = False,
        prior: tuple[float, float] | None = None,
    ) -> JointFit:
        return JointFit(self.cause, seen, self.search.noise, same, prior, self.search.runs)

    def _turned(self, seen: FittedExperiment, z: Array) -> float:
        """The start angle at which a descent of this experiment begins."""
        newest = self.search.descent(np.ones(len(self.search.experiment), dtype=bool))
        place = newest.angle(0)
        angle = 0.0 if place is None else float(self.search.best.q[place])
        if seen.start.spread[ANGLE] == 0 or seen.experiment is self.search.experiment:
            return angle
        known = believe(self._angles, self.cause.turn).angle
        likely = [angle] if known is None else [angle, known]
        parts = [self.cause.turn * (k + 0.5) / ANGLES_TRIED for k in range(ANGLES_TRIED)]
        limit = MOST_RATIO * self.search.best.rms
        best, least = angle, math.inf
        for tried in [*likely, *parts]:
            rms = self._rms(seen, z, tried)
            if rms < least:
                best, least = tried, rms
            if rms < limit:
                break
        return best

    def _rms(self, seen: FittedExperiment, z: Array, angle: float) -> float:
        descent = self._descent([seen])
        rest = descent.rest(descent.point(z, [angle]), 0)[seen.keep]
        return rms(rest)

    def _holds(self, e: Experiment, start: UncertainStart) -> bool:
        """Whether the newest experiment's machine can have made this one."""
        if e is self.search.experiment:
            return True
        seen = FittedExperiment(e, start, np.ones(len(e), dtype=bool))
        best, d = self.search.best, len(self.cause.names)
        z, std = best.q[:d], np.sqrt(np.diag(best.covariance))[:d]
        angle = self._turned(seen, z)
        shifts = [np.zeros(d), *(np.diag(std)[j] * s for j in range(d) for s in (2.0, -2.0))]
        near = (np.clip(z + s, self.cause.low, self.cause.high) for s in shifts)
        return any(self._rms(seen, n, angle) < MOST_RATIO * best.rms for n in near)

    def _weigh(self, descent: JointFit, minimum: Minimum) -> tuple[AngleBelief, list[FoundAngle]]:
        if self.cause.turn == 0:
            return AngleBelief(1.0, None, 0.0), []
        new = []
        for i, seen in enumerate(descent.seen):
            place = descent.angle(i)
            if place is not None and seen.start.rest:
                std = math.sqrt(minimum.covariance[place, place])
                new.append(FoundAngle(seen.experiment.number, float(minimum.q[place]), std))
        angles = together(self._angles, new, self.cause.turn)
        return believe(angles, self.cause.turn), angles

    def _z_at(self, descent: JointFit, minimum: Minimum, belief: AngleBelief) -> Array:
        """The coordinates that go with the common start angle: the two make up for each other."""
        d = len(self.cause.names)
        places = [p for p in map(descent.angle, range(len(descent.seen))) if p is not None]
        off = (belief.angle or 0.0) - minimum.q[places]
        off -= self.cause.turn * np.round(off / self.cause.turn)
        cross = minimum.covariance[:d][:, places]
        move = cross @ np.linalg.solve(minimum.covariance[np.ix_(places, places)], off)
        return np.clip(minimum.q[:d] + move, self.cause.low, self.cause.high)

    def _alike(self, belief: AngleBelief, seen: Sequence[FittedExperiment]) -> bool:
        """Whether the experiments are to be fitted with one start angle for all."""
        if belief.same < 0.5 or not all(s.start.rest for s in seen):
            return False
        return len(seen) > 1 or bool(self._before)
