"""The least squares of a grey box on some experiments, and how it descends to a minimum."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment, rms
from ldt_core.base.pausable import Pausable
from ldt_core.estimation.effect.start_angle import FoundAngle
from ldt_core.estimation.grey_box import (
    ANGLES,
    COARSE_STEP,
    FINE_STEP,
    Case,
    GreyBox,
    Prior,
)
from ldt_core.estimation.least_squares import damped_step
from ldt_core.estimation.misfit import misfit, setting
from ldt_core.physics.base import ANGLE, CURRENT, SPEED

#: Difference quotients: of a coordinate. Their rounding error and their curvature error are alike
#: for a simulation that is exact to 1e-9.
DIFFERENCE = 1e-3
#: Longest change of a coordinate in one step: one tolerance, one scale.
LONGEST_STEP = 1.0
#: Levenberg-Marquardt damping, as a part of the curvature: at the start, and its bounds.
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-9, 1e6
#: Residuals that are not simulated again: what one step of a fit asks for, and the step before it.
REMEMBERED = 256
#: Relative gain of one step below which a fit has ended: far below what one sample changes.
LEAST_GAIN = 1e-4
#: The same of what a step is expected to gain, to first order; beyond that it gains some more.
LEAST_EXPECTED = LEAST_GAIN / 10


class _Beside(NamedTuple):
    """Difference quotients: (coordinates, experiment), coordinate moved, and by how much of it."""

    cases: list[tuple[Array, int]]
    columns: list[int]
    steps: Array


class GreyBoxProblem:
    """The least squares of one grey box on some experiments.

    Args:
        box: machine and effects.
        experiments: measured.
        noise: standard deviation of the measured speed [rad/s], by which residuals are divided.
        prior: of the machine's coordinates.
        keep: of each experiment (L,) the samples that count; None counts all.
        turn: angle [rad] by which unknown starts at rest may differ without a difference in speed;
            0 where the start angle makes none, or is 0.
        workers: threads among which simulations are spread.
    """

    def __init__(
        self,
        box: GreyBox,
        experiments: Sequence[Experiment],
        noise: float,
        prior: Prior,
        keep: Sequence[NDArray[np.bool_]] | None = None,
        turn: float = 0.0,
        workers: int = 1,
    ) -> None:
        self.box, self.experiments, self.noise = box, list(experiments), noise
        self.prior, self.workers, self.turn = prior, workers, turn
        self.settings = [setting(e.voltage, e.speed) for e in experiments]
        self.keep = [np.ones(len(e), bool) for e in experiments] if keep is None else list(keep)
        self.rest = [box.at_rest(e, noise) for e in experiments]
        # Of each experiment the unknown first states, and their standard deviations beforehand.
        self._own: list[list[int]] = []
        self._spread: list[Array] = []
        for e, rest in zip(self.experiments, self.rest, strict=True):
            known = [] if rest else [SPEED] if e.current is not None else [SPEED, CURRENT]
            wide = [noise, float(np.abs(e.voltage).max()) / box.nominal["R"]][: len(known)]
            if turn > 0:
                known, wide = [ANGLE, *known], [1.0, *wide]
            self._own.append(known)
            self._spread.append(np.maximum(np.array(wide), 1e-12))
        ends = box.size + np.cumsum([0, *(len(own) for own in self._own)])
        self._places = [slice(a, b) for a, b in itertools.pairwise(ends.tolist())]
        #: Coordinates in all: those of the grey box, then first states in their deviations.
        self.size = int(ends[-1])
        own = np.full(self.size - box.size, np.inf)
        self._low = np.concatenate([box.low, -own])
        self._high = np.concatenate([box.high, own])
        self._longest = np.concatenate([np.full(box.size, LONGEST_STEP), own])
        k = len(box.uncertain)
        self._precision = np.zeros((self.size, self.size))
        self._precision[:k, :k] = prior.precision
        for own_states, place in zip(self._own, self._places, strict=True):
            # Of an angle nothing is known beforehand.
            self._precision[place, place] = np.diag([float(s != ANGLE) for s in own_states])
        self._mean = np.zeros(self.size)
        self._mean[:k] = prior.mean
        self._known: dict[tuple[bytes, bytes, int, float, float], Array] = {}  # simulated last

    def start(self, x: Array, i: int) -> Array:
        """(3,) offset of experiment i's first state."""
        offset = np.zeros(CURRENT + 1)
        offset[self._own[i]] = x[self._places[i]] * self._spread[i]
        return offset

    def residuals(
        self, asked: Sequence[tuple[Array, int]], gain: float, step: float
    ) -> list[Array]:
        """(L,) measured minus simulated speed [rad/s] of each (coordinates, experiment)."""
        n = self.box.size
        new: dict[tuple[bytes, bytes, int, float, float], Case] = {}
        keys = [(x[:n].tobytes(), x[self._places[i]].tobytes(), i, gain, step) for x, i in asked]
        found = {key: self._known[key] for key in keys if key in self._known}
        for key, (x, i) in zip(keys, asked, strict=True):
            if key not in found and key not in new:
                start = self.start(x, i) if self._own[i] else None
                new[key] = Case(x[:n], self.experiments[i], self.rest[i], start)
        speeds = self.box.speeds(list(new.values()), gain, step, self.workers)
        for key, speed in zip(new, speeds, strict=True):
            found[key] = self._known[key] = self.experiments[key[2]].speed - speed
        for key in list(self._known)[:-REMEMBERED]:
            del self._known[key]
        return [found[key] for key in keys]

    def rows(self, points: Sequence[Array], gain: float, step: float) -> list[Array]:
        """Of each point the residuals of all samples that count, in noise deviations."""
        count = len(self.experiments)
        rests = self.residuals([(x, i) for x in points for i in range(count)], gain, step)
        kept = [r[self.keep[k % count]] / self.noise for k, r in enumerate(rests)]
        return [np.concatenate(kept[k : k + count]) for k in range(0, len(kept), count)]

    def costs(self, points: Sequence[Array], gain: float, step: float) -> list[float]:
        """Of each point the squared residuals in noise deviations, and the prior's."""
        found = zip(points, self.rows(points, gain, step), strict=True)
        return [float(rows @ rows) + self._prior_cost(x) for x, rows in found]

    def _prior_cost(self, x: Array) -> float:
        off = x - self._mean
        return float(off @ self._precision @ off)

    def slopes(self, x: Array, rows: Array, gain: float, step: float) -> Array:
        """(rows, size) change of the rows by each coordinate."""
        asked = self._beside(x)
        return self._quotients(rows, asked, self.residuals(asked.cases, gain, step))

    def _with_slopes(self, x: Array, gain: float, step: float) -> tuple[Array, Array]:
        """The rows, and their slopes."""
        asked, count = self._beside(x), len(self.experiments)
        rests = self.residuals([*((x, i) for i in range(count)), *asked.cases], gain, step)
        kept = [r[k] / self.noise for r, k in zip(rests[:count], self.keep, strict=True)]
        rows = np.concatenate(kept)
        return rows, self._quotients(rows, asked, rests[count:])

    def _beside(self, x: Array) -> _Beside:
        """What difference quotients ask for."""
        asked, columns, steps = [], [], np.empty(self.size)
        for j in range(self.size):
            steps[j] = DIFFERENCE if x[j] + DIFFERENCE <= self._high[j] else -DIFFERENCE
            moved = x.copy()
            moved[j] += steps[j]
            for i, place in enumerate(self._places):
                if j < self.box.size or place.start <= j < place.stop:
                    asked.append((moved, i))
                    columns.append(j)
        return _Beside(asked, columns, steps)

    def _quotients(self, rows: Array, asked: _Beside, rests: Sequence[Array]) -> Array:
        ends = np.cumsum([0, *(int(k.sum()) for k in self.keep)])
        slopes = np.zeros((rows.size, self.size))
        for rest, (_, i), j in zip(rests, asked.cases, asked.columns, strict=True):
            part = slice(ends[i], ends[i + 1])
            slopes[part, j] = (rest[self.keep[i]] / self.noise - rows[part]) / asked.steps[j]
        return slopes

    def descend(
        self, x: Array, gain: float, step: float, rounds: int
    ) -> Pausable[tuple[Array, float, Array]]:
        """(coordinates, cost, information) of the minimum next to these coordinates.

        Levenberg-Marquardt with the scaling of Marquardt; coordinates at a bound stay there while
        the descent pushes against it.
        """
        from ldt_core.physics.lanes import WIDTH  # with its compiler, it takes a second to import

        x = np.clip(x, self._low, self._high)
        ahead: Array | None
        rows, ahead = self._with_slopes(x, gain, step)
        cost, damping = float(rows @ rows) + self._prior_cost(x), FIRST_DAMPING
        information = self._precision
        surely = True  # whether the last step helped as it was
        for _ in range(rounds):
            yield self.box.work.taken()
            slopes = self.slopes(x, rows, gain, step) if ahead is None else ahead
            information = slopes.T @ slopes + self._precision
            slope = slopes.T @ rows + self._precision @ (x - self._mean)
            free = ~(((x <= self._low) & (slope > 0)) | ((x >= self._high) & (slope < 0)))
            moved = ahead = None
            first = damping
            by = self._stepped(x, information, slope, free, damping) - x
            if -float(by @ (2 * slope + information @ by)) < LEAST_EXPECTED * cost:
                break
            while damping < MOST_DAMPING and moved is None:
                # Side by side, what is asked for next takes lanes that would be left over: the
                # slopes behind a step that helps, or smaller steps.
                count = 1 if surely else max(1, WIDTH // len(self.experiments))
                dampings = [damping * 10**k for k in range(count)]
                tried = [self._stepped(x, information, slope, free, d) for d in dampings]
                if surely:
                    better, ahead = self._with_slopes(tried[0], gain, step)
                    found = [better]
                else:
                    found = self.rows(tried, gain, step)
                for there, rest, damping in zip(tried, found, dampings, strict=True):
                    reached = float(rest @ rest) + self._prior_cost(there)
                    if damping < MOST_DAMPING and reached < cost:
                        moved, better = there, rest
                        break
                else:
                    damping, surely, ahead = 10 * damping, False, None
            if moved is None:
                break
            gained, x, rows, cost = (cost - reached) / cost, moved, better, reached
            surely, damping = damping == first, max(damping / 10, LEAST_DAMPING)
            if gained < LEAST_GAIN:
                break
        return x, cost, information

    def _stepped(
        self, x: Array, information: Array, slope: Array, free: NDArray[np.bool_], damping: float
    ) -> Array:
        """Coordinates behind a damped step."""
        by, inner = np.zeros(self.size), np.ix_(free, free)
        if free.any():
            by[free] = damped_step(information[inner], slope[free], damping, self._longest[free])
        return np.clip(x + by, self._low, self._high)

    def explains(self, x: Array, gain: float, step: float) -> bool:
        """Whether the innovations are noise, of a free run the residuals."""
        rest = self.residuals([(x, i) for i in range(len(self.experiments))], gain, step)
        kept = [r[kept] for r, kept in zip(rest, self.keep, strict=True)]
        return self.noise_alone(kept, gain=gain)

    def coarse_is_enough(self, x: Array) -> bool:
        """Whether a free run leaves more than noise, and would whatever the integration step.

        The step's error, as root mean square, is less than the noise there.
        """
        asked = [(x, i) for i in range(len(self.experiments))]
        coarse, fine = (self.residuals(asked, 0.0, step) for step in (COARSE_STEP, FINE_STEP))
        for keep, rest, exact in zip(self.keep, coarse, fine, strict=True):
            if not rms((rest - exact)[keep]) < self.noise:
                return False
        return not self.noise_alone([r[keep] for r, keep in zip(fine, self.keep, strict=True)])

    def noise_alone(self, rests: Sequence[Array], unit: float = 1.0, gain: float = 0.0) -> bool:
        """Whether the kept samples of what is left of each experiment, in a unit, are noise.

        An observer that is behind catches up within some samples: blows tell nothing of those.
        """
        settings = [replace(s, quiet=math.inf) if gain > 0 else s for s in self.settings]
        return all(
            misfit(rest, None, under.part(kept, unit)).explained
            for rest, under, kept in zip(rests, settings, self.keep, strict=True)
        )

    def point(self, q: Array) -> Array:
        """(size,) these coordinates of the grey box, and first states as they are guessed."""
        return np.concatenate([q, np.zeros(self.size - self.box.size)])

    def turned(self, tried: Sequence[Array]) -> GreyBoxProblem:
        """The problem with the start angles as unknowns, where at one of some q they matter."""
        turn = self.box.turn(tried, self.experiments[0], self.noise)
        if turn == 0:
            return self
        given = (self.box, self.experiments, self.noise, self.prior, self.keep)
        return GreyBoxProblem(*given, turn=turn, workers=self.workers)

    def with_angles(self, guesses: Sequence[Array], gain: float) -> list[Array]:
        """(size,) each of these coordinates with the best start angle for each experiment."""
        points, asked, places = [self.point(q) for q in guesses], [], []
        for x in points:
            for i, place in enumerate(self._places):
                if ANGLE not in self._own[i]:
                    continue
                places.append((x, place.start))
                for part in range(ANGLES):
                    turned = x.copy()
                    turned[place.start] = self.turn * part / ANGLES
                    asked.append((turned, i))
        rests = self.residuals(asked, gain, COARSE_STEP)
        kept = [r[self.keep[i]] / self.noise for r, (_, i) in zip(rests, asked, strict=True)]
        costs = np.array([float(r @ r) for r in kept]).reshape(-1, ANGLES)
        for (x, at), of_angles in zip(places, costs, strict=True):
            x[at] = self.turn * int(np.argmin(of_angles)) / ANGLES
        return points

    def angles(self, x: Array, information: Array) -> tuple[FoundAngle, ...]:
        """The start angles found, with their deviations for white noise."""
        if self.turn == 0:
            return ()
        variance = np.diag(np.linalg.pinv(information, hermitian=True))
        found = []
        for e, own, place in zip(self.experiments, self._own, self._places, strict=True):
            if own == [ANGLE]:
                std = math.sqrt(max(float(variance[place.start]), 0.0))
                found.append(FoundAngle(e.number, float(x[place.start]), std))
        return tuple(found)
