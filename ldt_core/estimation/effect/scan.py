"""Where in the effect's parameters to look: free runs of one experiment on a grid.

The sum of squares over an unbalance has many minima, since the rotor is caught by a resonance of
its foundation or not; near the edge, 1 % decides. The grid is fine enough that a descent from its
best point reached the noise in all of 90 trials on worn rotors, with the true value midway between
two grid points.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.experiment import Experiment
from ldt_core.estimation.effect.cause import Array, Cause, UncertainStart

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


class Scan:
    """Free runs of one experiment over the effect's parameters and the start angle.

    Args:
        cause: machine and effect.
        experiment: measured.
        start: what is known of its first state.
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
        size = float(np.sqrt(np.mean(experiment.speed**2)))
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
        """Finer about the best points, in the effect's parameters and in the start angle.

        Args:
            keep: (L,) bool, samples that count.
        """
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
        """The points in the order of their distance from the measurement, near ones left out.

        Args:
            keep: (L,) bool, samples that count.
        """
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
        for z, angle in points:
            z = np.asarray(z, dtype=np.float64)
            if (z.tobytes(), angle) in self._done:
                continue
            self._done.add((z.tobytes(), angle))
            offset = self.cause.offset(angle)
            run = self.cause.speed(self.experiment, z, offset, self.start.rest, INTEGRATION_STEP)
            self._points.append((z, angle))
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
