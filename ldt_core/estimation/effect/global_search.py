"""The newest experiment's cause, and with it all free runs that were made on the way."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.estimation.effect.cause import Array, Cause
from ldt_core.estimation.effect.joint_fit import FittedExperiment, JointFit, Minimum
from ldt_core.estimation.effect.scan import Point, Scan
from ldt_core.estimation.noise import white_noise

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


class EffectSearch:
    """The effect's parameters and the start state that explain one experiment.

    The scan is made once; the fit to a part of the experiment is chosen from the same free runs.

    Args:
        cause: machine and effect.
        experiment: measured.
        seeds: coordinates and start angles to try beside the scan's own.

    Raises:
        LdtError: the effect does not show in this experiment.
    """

    def __init__(self, cause: Cause, experiment: Experiment, seeds: Sequence[Point]) -> None:
        self.cause, self.experiment = cause, experiment
        size = float(np.sqrt(np.mean(experiment.speed**2))) or 1.0
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
        """The best fit of some samples (L,).

        The fit of all of them is a point to descend from like those of the scan; what comes of it
        is judged by the part alone.
        """
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

        There are experiments in which 0.005 % of the unbalance decides on which side of a resonance
        the rotor ends. No scan hits that, but what comes before tells the unbalance nearly as well.
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
