"""The newest experiment's cause: free runs on a grid of the effect's parameters, then descents.

The sum of squares over an unbalance has many minima, since the rotor is caught by a resonance of
its foundation or not; near the edge, 1 % decides. The grid is fine enough that a descent from its
best point reached the noise in all of 90 trials on worn rotors, with the true value midway between
two grid points.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment, rms
from ldt_core.estimation.effect.cause import Cause, CauseRun, UncertainStart
from ldt_core.estimation.effect.joint_fit import FittedExperiment, JointFit, Minimum
from ldt_core.estimation.noise import white_noise

INTEGRATION_STEP = 2e-3  # s, longest: good to some per cent near the edge of capture
REACH = 2.0  # scales of the parameter on either side of its neutral and of its typical value
POINTS_PER_SCALE = 20  # so that a descent from the best one reached the noise in 90 of 90 trials
WIDENINGS = 3  # doublings of the reach while the best value lies at its end
BOX_POINTS = 200  # for an effect with several parameters, spread evenly in their box
ANGLES_PER_HALF_TURN = 2  # start angles: a closer look has twice as many
ROBUST_SHARE = 0.03  # of the speed's root mean square: a deviation above this counts little more
ROBUST_NOISES = 3.0  # noise deviations, the least width of what counts in full
LEAST_DISTANCE = 1.01  # grid steps between two minima: neighbours on the grid are one
CLOSER_LOOKS = 3  # minima that are looked at more closely when the best leads nowhere

Point = tuple[Array, float]  # the effect's coordinates, the start angle
DESCENTS = (1, 2)  # from the scan's best point, then from the best of a closer look
BEGINNINGS = (0.5, 0.25, 0.125)  # shares of an experiment from which it is fitted step by step
DESCENTS_OF_BEGINNING = 3  # for each: the scan's best point may be the wrong side of a resonance
EXTENSIONS = 8  # from a beginning to the whole: each is short enough to follow the minimum
SAME_MINIMUM = 1e-3  # scales of the first parameter, and share of the residual, apart at most
ALONG_WIDTH = 4.0  # deviations either way, looked through where an extension fails
ALONG_POINTS = 33  # in that width: four a deviation
NOISE_LIKE = 1.3  # times the white noise: a residual above this is more than noise
BLOCK = 20  # samples: their mean shows slow errors of a fifth of the noise
BLOCK_DEVIATIONS = 6.0  # of white noise's block means; a neighbouring minimum shows there first
NOISE_FLOOR = 1e-6  # of the speed's size: a simulation without noise must not divide by 0
LEAST_SCORE_RANGE = 1e-9  # of a scan's scores: below, the effect shows in nothing


class Scan:
    """Free runs of one experiment over the effect's parameters and the start angle.

    Args:
        cause, experiment, start: machine and effect, what was measured, what is known of its start.
        noise: standard deviation of the measured speed [rad/s].
        seeds: more coordinates to try: what was found in earlier experiments.
    """

    def __init__(
        self,
        cause: Cause,
        experiment: Experiment,
        start: UncertainStart,
        noise: float,
        seeds: Sequence[Point] = (),
    ) -> None:
        self.cause, self.experiment, self.start = cause, experiment, start
        size = rms(experiment.speed)
        self._width = max(ROBUST_NOISES * noise, ROBUST_SHARE * size, 1e-9)
        self._points: list[Point] = []
        self._rests: list[Array] = []
        self._done: set[tuple[bytes, float]] = set()
        self._angles = _angles(cause.turn, ANGLES_PER_HALF_TURN)
        self._add(seeds)
        if len(cause.names) == 1:
            self._line()
        else:
            self._add(itertools.product(_box(cause), self._angles))

    def look_closer(self, keep: Array) -> None:
        """Finer about the best points, in the effect's parameters and in the start angle."""
        angles = _angles(self.cause.turn, 2 * ANGLES_PER_HALF_TURN)
        for z, _ in list(itertools.islice(self.best(keep), CLOSER_LOOKS)):
            for step in (-0.5, 0.0, 0.5):
                near = np.clip(z + step / POINTS_PER_SCALE, self.cause.low, self.cause.high)
                self._add((near, angle) for angle in angles)

    def refine(self) -> None:
        """Twice as fine everywhere."""
        angles = _angles(self.cause.turn, 2 * ANGLES_PER_HALF_TURN)
        coordinates = _distinct(z for z, _ in self._points)
        if len(self.cause.names) == 1:
            between = [(a + b) / 2 for a, b in itertools.pairwise(coordinates)]
        else:
            between = _box(self.cause, BOX_POINTS)
        self._add(itertools.product(between, self._angles))
        self._add(itertools.product(coordinates, angles))

    def best(self, keep: NDArray[Any]) -> Iterator[Point]:
        """The points by their distance from the samples that count, near ones left out."""
        scores = self.scores(keep)
        seen: list[Array] = []
        for i in np.argsort(scores, kind="stable"):
            z, angle = self._points[i]
            if all(np.abs(z - other).max() > LEAST_DISTANCE / POINTS_PER_SCALE for other in seen):
                seen.append(z)
                yield z, angle

    def scores(self, keep: NDArray[Any]) -> Array:
        """(points,) mean logarithm of 1 + (residual / width)^2: what fits for long counts."""
        return np.array([self.score(rest, keep) for rest in self._rests])

    def score(self, rest: Array, keep: Array) -> float:
        """The same for another residual (L,) [rad/s]."""
        return float(np.mean(np.log1p((rest[keep] / self._width) ** 2)))

    def _line(self) -> None:
        low, high = float(self.cause.low[0]), float(self.cause.high[0])
        centres = {0.0, float(self.cause.typical[0])}
        values = [np.clip(c + _grid(-REACH, REACH), low, high) for c in centres]
        self._add(itertools.product(np.unique(np.concatenate(values))[:, None], self._angles))
        everything = np.ones(len(self.experiment), dtype=bool)
        for reach in REACH * 2.0 ** np.arange(WIDENINGS):
            best = float(next(self.best(everything))[0][0])
            have = [z[0] for z, _ in self._points]
            if best - min(have) < 2 / POINTS_PER_SCALE and best > low:
                more = best - _grid(0.0, reach)
            elif max(have) - best < 2 / POINTS_PER_SCALE and best < high:
                more = best + _grid(0.0, reach)
            else:
                return
            fresh = np.unique(np.clip(more, low, high))
            self._add(itertools.product(fresh[:, None], self._angles))

    def _add(self, points: Sequence[Point] | Iterator[Point]) -> None:
        fresh = []
        for z, angle in points:
            point = np.asarray(z, dtype=np.float64), angle
            if (point[0].tobytes(), angle) not in self._done:
                self._done.add((point[0].tobytes(), angle))
                fresh.append(point)
        asked = [
            CauseRun(self.experiment, z, self.cause.offset(angle), self.start.rest)
            for z, angle in fresh
        ]
        self._points += fresh
        for run in self.cause.speeds(asked, INTEGRATION_STEP):
            self._rests.append(self.experiment.speed - run)


def _grid(low: float, high: float) -> Array:
    return np.linspace(low, high, round((high - low) * POINTS_PER_SCALE) + 1)


def _angles(turn: float, count: int) -> list[float]:
    """Evenly spread, from the middle of the first part; one when the angle does not matter."""
    parts = count * round(turn / np.pi) if turn > 0 else 1
    return [turn * (i + 0.5) / parts for i in range(parts)]


def _distinct(coordinates: Iterator[Array]) -> list[Array]:
    return [np.array(z) for z in sorted({tuple(z.tolist()) for z in coordinates})]


def _box(cause: Cause, skip: int = 0) -> list[Array]:
    """BOX_POINTS points of Halton's sequence in the box about neutral and typical values."""
    from scipy.stats import qmc  # 0.4 s to import, for effects with several parameters alone

    typical = cause.typical
    low = np.maximum(np.minimum(0.0, typical) - REACH, cause.low)
    high = np.minimum(np.maximum(0.0, typical) + REACH, cause.high)
    sequence = qmc.Halton(len(cause.names), scramble=False)
    sequence.fast_forward(1 + skip)
    inside = low + (high - low) * sequence.random(BOX_POINTS)
    return [np.clip(np.zeros(low.size), low, high), typical, *inside]


class EffectSearch:
    """The effect's parameters and the start state that explain one experiment.

    The scan is made once; the fit to a part of the experiment is chosen from the same free runs.
    `seeds` are coordinates and start angles to try beside the scan's own.

    Raises:
        LdtError: the effect does not show in this experiment.
    """

    def __init__(self, cause: Cause, experiment: Experiment, seeds: Sequence[Point]) -> None:
        self.cause, self.experiment = cause, experiment
        size = rms(experiment.speed) or 1.0
        self.noise = max(white_noise([experiment.speed]), NOISE_FLOOR * size)
        self.start = cause.start(experiment, self.noise, seeds[0][0])
        #: Free runs by experiment, coordinates and start, for all who fit the same experiments.
        self.runs: dict[Any, Array] = {}
        self._scan = Scan(cause, experiment, self.start, self.noise, seeds)
        self.best = self._whole()

    def descent(self, keep: Array) -> JointFit:
        """The fit of these samples (L,) of the experiment."""
        seen = FittedExperiment(self.experiment, self.start, keep)
        return JointFit(self.cause, [seen], self.noise, memory=self.runs)

    def part(self, keep: Array) -> Minimum:
        """The best fit of some samples (L,), from the scan or from the fit of all."""
        if keep.all():
            return self.best
        descent = self.descent(keep)
        starts = [self.best.q]
        z, angle = next(self._scan.best(keep))
        point = descent.point(z, [angle])
        whole = self._scan.score(descent.rest(self.best.q, 0), keep)
        if self._scan.score(descent.rest(point, 0), keep) < whole:
            starts.append(point)
        return min((descent.run(q) for q in starts), key=lambda m: m.rms)

    def _whole(self) -> Minimum:
        keep = np.ones(len(self.experiment), dtype=bool)
        if not float(np.ptp(self._scan.scores(keep))) > LEAST_SCORE_RANGE:
            raise LdtError(
                f"diagnosed model: experiment {self.experiment.number} says nothing about "
                f"{self.cause.effect.name}: its speed is the same with and without"
            )
        descent = self.descent(keep)
        found: list[Minimum] = []
        looks = (lambda: None, lambda: self._scan.look_closer(keep))
        tried: set[tuple[bytes, float]] = set()
        for look, tries in zip(looks, DESCENTS, strict=True):
            look()
            fresh = (p for p in self._scan.best(keep) if (p[0].tobytes(), p[1]) not in tried)
            for z, angle in itertools.islice(fresh, tries):
                tried.add((z.tobytes(), angle))
                found.append(descent.run(descent.point(z, [angle])))
                if self._noise_like(found[-1]):
                    return found[-1]
        followed = self._step_by_step()
        if followed is not None:
            return followed
        if not _twice(found):
            self._scan.refine()
            for z, angle in itertools.islice(self._scan.best(keep), DESCENTS[-1]):
                found.append(descent.run(descent.point(z, [angle])))
        return min(found, key=lambda m: m.rms)

    def _noise_like(self, minimum: Minimum) -> bool:
        """Whether nothing is left but noise, as large as it should be and white."""
        rest = minimum.rests[0]
        if rest.size < 2 * BLOCK:
            return minimum.rms < NOISE_LIKE * self.noise
        blocks = rest[: rest.size // BLOCK * BLOCK].reshape(-1, BLOCK)
        smooth = BLOCK * float(np.mean(blocks.mean(axis=1) ** 2)) / float(np.mean(blocks**2))
        limit = 1 + BLOCK_DEVIATIONS * math.sqrt(2 / len(blocks))
        return minimum.rms < NOISE_LIKE * self.noise and smooth < limit

    def _step_by_step(self) -> Minimum | None:
        """Fit the beginning, then more and more of the experiment; None if that leads nowhere.

        Where 0.005 % of the unbalance decides on which side of a resonance the rotor ends, no scan
        hits it, but what comes before tells the unbalance nearly as well.
        """
        length = len(self.experiment)
        for part in BEGINNINGS:
            end = round(length * part)
            descent = self._beginning(end)
            points = self._scan.best(np.arange(length) < end)
            for z, angle in itertools.islice(points, DESCENTS_OF_BEGINNING):
                minimum = descent.run(descent.point(z, [angle]))
                if self._noise_like(minimum):
                    followed = self._followed(minimum, end)
                    if followed is not None:
                        return followed
        return None

    def _followed(self, minimum: Minimum, begin: int) -> Minimum | None:
        length = len(self.experiment)
        for end in np.linspace(begin, length, EXTENSIONS + 1)[1:].round().astype(int):
            descent = self._beginning(int(end))
            further = descent.run(minimum.q)
            if not self._noise_like(further):
                keep = np.ones(end, dtype=bool)
                rows = self._along(minimum)
                scores = [self._scan.score(descent.rest(q, 0), keep) for q in rows]
                tried = descent.run(rows[int(np.argmin(scores))])
                further = min(further, tried, key=lambda m: m.rms)
            if further.rms > NOISE_LIKE * self.noise:
                return None
            minimum = further
        return minimum

    def _beginning(self, end: int) -> JointFit:
        seen = FittedExperiment(self.experiment.part(0, end), self.start, np.ones(end, dtype=bool))
        return JointFit(self.cause, [seen], self.noise, memory=self.runs)

    def _along(self, minimum: Minimum) -> list[Array]:
        """Points along the direction that is known least, as far as it is unknown."""
        deviations = np.sqrt(np.diag(minimum.covariance))
        values, vectors = np.linalg.eigh(minimum.covariance / np.outer(deviations, deviations))
        axis = vectors[:, -1] * math.sqrt(max(float(values[-1]), 0.0)) * deviations
        return [minimum.q + t * axis for t in np.linspace(-ALONG_WIDTH, ALONG_WIDTH, ALONG_POINTS)]


def _twice(found: Sequence[Minimum]) -> bool:
    """Whether two descents ended in the same, so that a finer scan would hardly find another."""
    return any(
        float(np.abs(one.q - other.q)[0]) < SAME_MINIMUM
        and abs(one.rms / other.rms - 1) < SAME_MINIMUM
        for one, other in itertools.combinations(found, 2)
    )
