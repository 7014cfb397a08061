"""Structures under an observer, to which few steps lead; the machine's parameters eliminated."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment
from ldt_core.base.pausable import Pausable, finished
from ldt_core.estimation.grey_box import COARSE_STEP, GreyBox, Prior
from ldt_core.estimation.grey_box_fit import FIRST_ROUNDS
from ldt_core.estimation.grey_box_problem import DIFFERENCE, LEAST_GAIN, GreyBoxProblem
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.effect import Effect
from ldt_core.physics.parameter import SMALLEST

#: Gains of the screenings, the strongest and the weakest: all of the innovation is for what
#: captures the shaft; a tenth, for what is weak and lasts, which so many samples' noise would hide.
STRONGEST, WEAKEST = 1.0, 0.1
#: Of the guesses' least sum of squares: what another size has to promise, to first order. What
#: promises less is found by the steps from the guesses as well, and would cost each effect a run.
WORTH_RESIZING = 0.5
#: Gauss-Newton steps of the screening; under the observer an effect is found in two or three.
SCREENING_STEPS = 4


@dataclass(frozen=True, eq=False)
class Present:
    """The structure that a search begins with.

    Attributes:
        effects: that act already, as far as is known.
        given: their values.
        prior: of the machine's coordinates.
    """

    effects: tuple[Effect, ...]
    given: dict[str, dict[str, float]]
    prior: Prior


@dataclass(frozen=True, eq=False)
class Screened:
    """A structure under the observer.

    Attributes:
        cost: squared innovations in noise deviations plus the price of the parameters.
        given: values of its effects.
        explains: whether the innovations are noise.
        work: integration steps that it took.
    """

    cost: float
    given: dict[str, dict[str, float]]
    explains: bool
    work: int


class Screening:
    """Tries structures of one machine on some experiments, each in few steps.

    Args:
        machine: as its file knows it.
        tolerances: relative standard deviations of its parameters.
        experiments: of the machine as it is now.
        noise: standard deviation of the measured speed [rad/s].
        workers: threads among which the work is spread.
    """

    def __init__(
        self,
        machine: Machine,
        tolerances: dict[str, float],
        experiments: Sequence[Experiment],
        noise: float,
        workers: int,
    ) -> None:
        self.machine, self.tolerances = machine, tolerances
        self.experiments, self.noise, self.workers = list(experiments), noise, workers
        self._samples = sum(len(e) for e in experiments)
        # Squared error, values and innovations of what was screened with the machine eliminated.
        self._known: dict[tuple[float, str, tuple[Effect, ...]], tuple[float, Array, Array]] = {}

    def problem(self, box: GreyBox, prior: Prior, workers: int | None = None) -> GreyBoxProblem:
        """The least squares of a structure."""
        count = self.workers if workers is None else workers
        return GreyBoxProblem(box, self.experiments, self.noise, prior, workers=count)

    def machine_slopes(self, present: Present, gain: float) -> tuple[Array, NDArray[np.bool_]]:
        """What the machine's own parameters change, prior rows below, and which change nothing.

        An orthonormal basis; and (k,) those that the present effects leave without any effect, as
        a foundation is that nothing shakes.
        """
        box = GreyBox(self.machine, present.effects, self.tolerances)
        k = len(box.uncertain)
        problem = self.problem(box, present.prior)
        x = problem.point(box.coordinates(present.given, present.prior.mean))
        rows = problem.rows([x], gain, COARSE_STEP)[0]
        slopes = problem.slopes(x, rows, gain, COARSE_STEP)
        slopes = np.delete(slopes, np.arange(k, box.size), axis=1)
        root = np.linalg.cholesky(present.prior.precision) if k else np.zeros((0, 0))
        below = np.eye(slopes.shape[1])
        below[:k, :k] = root.T
        silent = ~np.any(slopes[:, :k], axis=0)
        return np.linalg.qr(np.vstack([slopes, below]))[0], silent

    def screened(
        self,
        present: Present,
        effects: Sequence[Effect],
        basis: Array,
        gain: float,
        silent: NDArray[np.bool_],
    ) -> Screened:
        """Least squared residuals under the observer, the machine's parameters eliminated.

        To first order, about the present structure. Where an effect makes parameters act that did
        nothing there, their slopes are not known: those that are `silent` are fitted with it.
        """
        box = GreyBox(self.machine, effects, self.tolerances)
        problem = self.problem(box, present.prior, workers=1)
        k = len(box.uncertain)
        asked = gain, repr(present.given), tuple(effects)
        if asked not in self._known:
            self._known[asked] = self._eliminated(present, problem, basis, gain)
        best, q, rows = self._known[asked]
        if silent.any():
            x = problem.point(np.concatenate([present.prior.mean, q]))
            woken = x.copy()
            woken[:k][silent] += DIFFERENCE
            asleep, awake = problem.rows([x, woken], gain, COARSE_STEP)
            if np.any(awake != asleep):
                joint, cost, _ = finished(problem.descend(x, gain, COARSE_STEP, FIRST_ROUNDS))
                if cost < best:
                    best, q = cost, joint[k : box.size]
                    rows = problem.rows([joint], gain, COARSE_STEP)[0]
        given = {e.name: values for e, values in box.values(np.concatenate([np.zeros(k), q]))[1]}
        ends = np.cumsum([int(kept.sum()) for kept in problem.keep])
        parts = np.split(rows[: ends[-1]], ends[:-1])
        explains = problem.noise_alone(parts, problem.noise, gain)
        cost = best + q.size * math.log(self._samples)
        return Screened(cost, given, explains, box.work.taken())

    def still_alike(
        self, present: Present, rivals: Sequence[Effect], odds: float
    ) -> Pausable[list[str]]:
        """Names of those that explain the experiments as well in the place of the last effect, as
        far as the weakest observer tells.

        Args:
            present: effects that explain them.
            rivals: that were not told apart from the last of these before.
            odds: squared deviations by which they may be the worse.
        """
        if not rivals or not present.effects:
            return []
        gain, alike = WEAKEST, []
        basis, silent = self.machine_slopes(present, gain)
        asked = basis, gain, np.zeros_like(silent)
        own = self.screened(present, present.effects, *asked)
        yield own.work
        for rival in rivals:
            other = self.screened(present, (*present.effects[:-1], rival), *asked)
            yield other.work
            if other.explains and other.cost < own.cost + odds:
                alike.append(rival.name)
        return alike

    def leading(self, present: Present, tried: Sequence[Effect]) -> Pausable[list[Effect]]:
        """Those beside which the strongest observer leaves noise; a free run with another one
        hardly does.

        Args:
            present: effects that act as well.
        """
        if not tried:
            return []
        found = []
        basis, silent = self.machine_slopes(present, STRONGEST)
        for effect in tried:
            effects = (*present.effects, effect)
            beside = self.screened(present, effects, basis, STRONGEST, silent)
            yield beside.work
            if beside.explains:
                found.append(effect)
        return found

    def _eliminated(
        self, present: Present, problem: GreyBoxProblem, basis: Array, gain: float
    ) -> tuple[float, Array, Array]:
        """Squared error, effects' coordinates, and rows, the machine's parameters eliminated."""
        from ldt_core.physics.lanes import WIDTH  # see `GreyBoxProblem.descend`

        box = problem.box
        k, below = len(box.uncertain), basis.shape[0]

        def projected(rows: Array) -> Array:
            padded = np.concatenate([rows, np.zeros(below - rows.size)])
            return padded - basis @ (basis.T @ padded)

        def rows_at(tried: Sequence[Array]) -> list[Array]:
            points = [problem.point(np.concatenate([present.prior.mean, q])) for q in tried]
            return [projected(rows) for rows in problem.rows(points, gain, COARSE_STEP)]

        low, high = box.low[k:], box.high[k:]

        def beside(q: Array) -> list[Array]:
            return [q + step for step in np.diag(_differences(q, high))]

        def groups(count: int) -> int:  # of lanes, which a few runs fill as well as many
            return -(-count * len(self.experiments) // WIDTH)

        guesses = box.first_guesses(present.given)
        asked = [[guess, *beside(guess)] for guess in guesses]
        both = len(guesses) * len(asked[0])
        if groups(both) > groups(len(guesses)) + groups(box.size - k):
            asked = [[guess] for guess in guesses]
        found = iter(rows_at([q for some in asked for q in some]))
        tried = [[next(found) for _ in some] for some in asked]
        first = int(np.argmin([_squares(rows) for rows, *_ in tried]))
        q, (rows, *moved) = guesses[first], tried[first]
        best = _squares(rows)
        if not box.amounts.all():
            shapes = [rows for rows, *_ in tried]
            resized = self._resized(box, present, guesses, shapes, rows_at, best)
            if resized is not None and _squares(resized[1]) < best:
                (q, rows), moved = resized, []
                best = _squares(rows)
        for left in reversed(range(SCREENING_STEPS)):
            moved = moved or rows_at(beside(q))
            by = _differences(q, high)
            columns = np.empty((rows.size, q.size))
            for j, there in enumerate(moved):
                columns[:, j] = (there - rows) / by[j]
            whole = -np.linalg.lstsq(columns, rows, rcond=1e-9)[0]
            longest = max(1.0, float(np.abs(whole).max(initial=0.0)))
            # What is linear, as most of an effect is under the observer, is reached in a whole
            # step, however large; what bends is not overshot by a step of one scale.
            steps = [whole / longest] if longest == 1.0 else [whole / longest, whole]
            tried_to = [np.clip(q + step, low, high) for step in steps]
            expected = min(_squares(rows + columns @ (there - q)) for there in tried_to)
            if best - expected < LEAST_GAIN * best:
                break
            # With what the next step needs: it takes lanes that would be left over.
            near = beside(tried_to[0]) if left else []
            found_there = rows_at([*tried_to, *near])
            reached, which = min((_squares(r), i) for i, r in enumerate(found_there[: len(steps)]))
            if not reached < best:
                break
            there, better = tried_to[which], found_there[which]
            moved = found_there[len(steps) :] if which == 0 else []
            gained, best, q, rows = (best - reached) / best, reached, there, better
            if gained < LEAST_GAIN:
                break
        return best, q, rows

    def _resized(
        self,
        box: GreyBox,
        present: Present,
        guesses: Sequence[Array],
        found: Sequence[Array],
        rows_at: Callable[[Sequence[Array]], list[Array]],
        least: float,
    ) -> tuple[Array, Array] | None:
        """The guess of the best shape at its best size, both to first order, and its rows.

        One of the right shape may be far too large, and err more than all others. None where that
        promises too little beside the least sum of squares of the guesses.
        """
        k = len(box.uncertain)
        without = box.neutral_guess(present.given)
        (neutral,) = rows_at([without])
        changes = [rows - neutral for rows in found]
        sizes = [max(0.0, -float(neutral @ c) / max(_squares(c), SMALLEST)) for c in changes]
        left = [_squares(neutral + s * c) for s, c in zip(sizes, changes, strict=True)]
        i = int(np.argmin(left))
        if left[i] > WORTH_RESIZING * least:
            return None
        best = np.where(box.amounts, without + sizes[i] * (guesses[i] - without), guesses[i])
        best = np.clip(best, box.low[k:], box.high[k:])
        return best, rows_at([best])[0]


def _squares(rows: Array) -> float:
    with np.errstate(over="ignore"):  # of a run that explodes
        return float(rows @ rows)


def _differences(q: Array, high: Array) -> Array:
    """By how much each coordinate is moved for its difference quotient."""
    return np.where(q + DIFFERENCE <= high, DIFFERENCE, -DIFFERENCE)
