"""The fit of a grey box to experiments: from an observer to the free run.

Near a resonance that captures the shaft, the squared error of a free run has many minima. So the
fit begins with an observer, which corrects the simulated speed by the measured one at every sample:
the squared innovations have few minima, since no error lasts. Then the observer's gain falls to
zero, which is the free run, each fit starting from the last (a homotopy from prediction error to
simulation error: Ljung, "System Identification", 1999, section 7; Van Mulders et al., "Two
nonlinear optimization methods for black box identification compared", Automatica 46, 2010).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment
from ldt_core.estimation.effect.start_angle import FoundAngle
from ldt_core.estimation.grey_box import (
    ANGLE,
    ANGLES,
    COARSE_STEP,
    CURRENT,
    FINE_STEP,
    SPEED,
    Case,
    GreyBox,
    Prior,
)
from ldt_core.estimation.misfit import misfit, noise_in, setting

#: Observer gains of the homotopy: all of the innovation, then less, then the free run.
GAINS = (1.0, 0.3, 0.1, 0.03, 0.0)
#: Factor from gain to gain below these, where the free run is too far from the weakest observer.
#: They end where the observer remembers the whole experiment, which is a free run.
FINER = 0.3
#: Difference quotients: of a coordinate. Their rounding error and their curvature error are alike
#: for a simulation that is exact to 1e-9.
DIFFERENCE = 1e-3
#: Longest change of a coordinate in one step: one tolerance, one scale.
LONGEST_STEP = 1.0
#: Levenberg-Marquardt damping, as a part of the curvature: at the start, and its bounds.
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-9, 1e6
#: Most steps under the strongest observer. It has to converge there, since all else follows from
#: where it ends: one parameter three tolerances away takes a dozen steps of at most one each.
FIRST_ROUNDS = 25
#: Guesses, the best by their cost under the observer, that are descended from at most, until the
#: residuals are noise.
TRIES = 2
#: Most steps at each further gain.
ROUNDS = 8
#: Steps at each further gain where even the strongest observer leaves more than noise: such a
#: structure cannot explain the machine, and only its size is of interest.
HOPELESS = 2
#: Relative gain of one step below which a fit has ended: far below what one sample changes.
LEAST_GAIN = 1e-4


@dataclass(frozen=True, eq=False)
class GreyBoxFit:
    """Where a fit ended.

    Attributes:
        q: (n,) coordinates of machine and effects.
        starts: of each experiment its offset of the first state, see `GreyBox.speed`.
        cost: squared residuals in noise deviations, and the prior's.
        residuals: of each experiment (L,) measured minus simulated [rad/s].
        explained: whether these residuals are noise, in the samples that count.
        noise: deviation of the noise in them [rad/s], see `noise_in`.
        information: (n, n) of the coordinates, start states eliminated, for white noise.
        turn: angle [rad] by which a start at rest may differ without a difference; 0 for any.
        angles: start angles found.
    """

    q: Array
    starts: tuple[Array, ...]
    cost: float
    residuals: tuple[Array, ...]
    explained: bool
    noise: float
    information: Array
    turn: float = 0.0
    angles: tuple[FoundAngle, ...] = ()


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
        k = len(box.uncertain)
        self._precision = np.zeros((self.size, self.size))
        self._precision[:k, :k] = prior.precision
        for own_states, place in zip(self._own, self._places, strict=True):
            # Of an angle nothing is known beforehand.
            self._precision[place, place] = np.diag([float(s != ANGLE) for s in own_states])
        self._mean = np.zeros(self.size)
        self._mean[:k] = prior.mean

    def start(self, x: Array, i: int) -> Array:
        """(3,) offset of experiment i's first state."""
        offset = np.zeros(CURRENT + 1)
        offset[self._own[i]] = x[self._places[i]] * self._spread[i]
        return offset

    def residuals(
        self, asked: Sequence[tuple[Array, int]], gain: float, step: float
    ) -> list[Array]:
        """(L,) measured minus simulated speed [rad/s] of each (coordinates, experiment)."""
        n, cases = self.box.size, []
        for x, i in asked:
            start = self.start(x, i) if self._own[i] else None
            cases.append(Case(x[:n], self.experiments[i], self.rest[i], start))
        speeds = self.box.speeds(cases, gain, step, self.workers)
        return [self.experiments[i].speed - s for (_, i), s in zip(asked, speeds, strict=True)]

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
        ends = np.cumsum([0, *(int(k.sum()) for k in self.keep)])
        slopes, steps = np.zeros((rows.size, self.size)), np.empty(self.size)
        asked, columns = [], []
        for j in range(self.size):
            steps[j] = DIFFERENCE if x[j] + DIFFERENCE <= self._high[j] else -DIFFERENCE
            moved = x.copy()
            moved[j] += steps[j]
            for i, place in enumerate(self._places):
                if j < self.box.size or place.start <= j < place.stop:
                    asked.append((moved, i))
                    columns.append(j)
        rests = self.residuals(asked, gain, step)
        for rest, (_, i), j in zip(rests, asked, columns, strict=True):
            part = slice(ends[i], ends[i + 1])
            slopes[part, j] = (rest[self.keep[i]] / self.noise - rows[part]) / steps[j]
        return slopes

    def descend(
        self, x: Array, gain: float, step: float, rounds: int
    ) -> tuple[Array, float, Array]:
        """(coordinates, cost, information) of the minimum next to these coordinates.

        Levenberg-Marquardt with the scaling of Marquardt; coordinates at a bound stay there while
        the descent pushes against it.
        """
        x = np.clip(x, self._low, self._high)
        rows = self.rows([x], gain, step)[0]
        cost, damping = float(rows @ rows) + self._prior_cost(x), FIRST_DAMPING
        information = self._precision
        for _ in range(rounds):
            slopes = self.slopes(x, rows, gain, step)
            information = slopes.T @ slopes + self._precision
            slope = slopes.T @ rows + self._precision @ (x - self._mean)
            free = ~(((x <= self._low) & (slope > 0)) | ((x >= self._high) & (slope < 0)))
            moved = None
            while damping < MOST_DAMPING:
                step_to = np.zeros(self.size)
                scaled = information[np.ix_(free, free)]
                diagonal = np.diag(scaled)
                scaled = scaled + np.diag(damping * diagonal + 1e-12 * (diagonal.max() + 1e-300))
                step_to[free] = -np.linalg.solve(scaled, slope[free])
                step_to /= max(1.0, float(np.abs(step_to[: self.box.size]).max()) / LONGEST_STEP)
                tried = np.clip(x + step_to, self._low, self._high)
                better = self.rows([tried], gain, step)[0]
                reached = float(better @ better) + self._prior_cost(tried)
                if reached < cost:
                    moved = tried
                    break
                damping *= 10
            if moved is None:
                break
            gained, x, rows, cost = (cost - reached) / cost, moved, better, reached
            damping = max(damping / 10, LEAST_DAMPING)
            if gained < LEAST_GAIN:
                break
        return x, cost, information

    def explains(self, x: Array, gain: float, step: float) -> bool:
        """Whether the innovations are noise, of a free run the residuals."""
        rest = self.residuals([(x, i) for i in range(len(self.experiments))], gain, step)
        return self.noise_alone([r[kept] for r, kept in zip(rest, self.keep, strict=True)])

    def noise_alone(self, rests: Sequence[Array], unit: float = 1.0) -> bool:
        """Whether the kept samples of what is left of each experiment, in a unit, are noise."""
        return all(
            misfit(rest, None, under.part(kept, unit)).explained
            for rest, under, kept in zip(rests, self.settings, self.keep, strict=True)
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


def fit_grey_box(
    problem: GreyBoxProblem,
    guesses: Sequence[Array],
    near: Array | None = None,
    sized: bool = True,
) -> GreyBoxFit:
    """The best fit that the homotopy finds from some guesses, or the next one to a known fit.

    Args:
        problem: what to fit.
        guesses: (n,) coordinates of the grey box each.
        near: (n,) coordinates of what has explained other experiments of the same machine. Where
            the minimum next to them explains these too, nothing else is asked; without guesses,
            where it does not either.
        sized: whether the size of what is left is of interest where it is more than noise. Else a
            fit ends where an observer leaves more: a weaker one will not leave less.
    """
    problem = problem.turned(guesses if near is None else [near])
    if near is not None:
        x = problem.with_angles([near], GAINS[0])[0]
        known = _ended(problem, _released(problem, x, ROUNDS))
        if known.explained or not len(guesses):
            return known
        problem = problem.turned(guesses)
    points = problem.with_angles(guesses, GAINS[0])
    costs = problem.costs(points, GAINS[0], COARSE_STEP)
    best: GreyBoxFit | None = None
    led: list[Array] = []
    for i in np.argsort(costs, kind="stable")[:TRIES]:
        x, _, information = problem.descend(points[i], GAINS[0], COARSE_STEP, FIRST_ROUNDS)
        # What the experiments cannot tell from where another guess has led goes the same way.
        apart = [float((x - other) @ information @ (x - other)) for other in led]
        if not sized and min(apart, default=math.inf) < 1.0:
            continue
        led.append(x)
        found = _ended(problem, _homotopy(problem, x, sized))
        if best is None or found.cost < best.cost:
            best = found
        if best.explained:
            break
    if best is None:
        raise ValueError("no guess to begin with")
    return best


def _ended(problem: GreyBoxProblem, end: tuple[Array, float, Array]) -> GreyBoxFit:
    x, cost, information = end
    n, count = problem.box.size, range(len(problem.experiments))
    inner = of_first(information, n)  # start states eliminated
    rests = problem.residuals([(x, i) for i in count], 0.0, FINE_STEP)
    return GreyBoxFit(
        x[:n],
        tuple(problem.start(x, i) for i in count),
        cost,
        tuple(rests),
        problem.noise_alone([r[kept] for r, kept in zip(rests, problem.keep, strict=True)]),
        float(np.mean([noise_in(r, m) for r, m in zip(rests, problem.settings, strict=True)])),
        inner,
        problem.turn,
        problem.angles(x, information),
    )


def of_first(information: Array, count: int) -> Array:
    """(count, count) information of the first coordinates, those behind them unknown."""
    inner, cross = information[:count, :count], information[:count, count:]
    if cross.size == 0:
        return inner
    behind = np.linalg.pinv(information[count:, count:], hermitian=True)
    return np.asarray(inner - cross @ behind @ cross.T)


def _homotopy(problem: GreyBoxProblem, x: Array, sized: bool) -> tuple[Array, float, Array]:
    """(coordinates, cost, information) of the free run, from a minimum under the observer."""
    gain = GAINS[0]
    led = problem.explains(x, gain, COARSE_STEP)
    rounds = ROUNDS if led else HOPELESS
    for gain in GAINS[1:-1]:
        if not sized and not led:
            return problem.descend(x, 0.0, COARSE_STEP, HOPELESS)
        x = problem.descend(x, gain, COARSE_STEP, rounds)[0]
        led = problem.explains(x, gain, COARSE_STEP)
    found = _released(problem, x, rounds)
    if not led or problem.explains(found[0], 0.0, FINE_STEP):
        return found
    # Right as long as it is led: the last step, to the free run, was too long.
    longest = max(len(e) for e in problem.experiments)
    while gain * longest > 1:
        gain *= FINER
        x = problem.descend(x, gain, COARSE_STEP, rounds)[0]
        if not sized and not problem.explains(x, gain, COARSE_STEP):
            return found
    return min(found, _released(problem, x, rounds), key=lambda end: end[1])


def _released(problem: GreyBoxProblem, x: Array, rounds: int) -> tuple[Array, float, Array]:
    """(coordinates, cost, information) of the free run's minimum next to these coordinates."""
    x = problem.descend(x, 0.0, COARSE_STEP, rounds)[0]
    return problem.descend(x, 0.0, FINE_STEP, rounds)
