"""Which effects to add to a machine so that it explains an experiment: a search over structures.

Every effect of a library is tried, beside those that are there and in their place, under the
observer of `grey_box`, which needs few steps. The machine's uncertain parameters are eliminated to
first order meanwhile, under their prior: what they explain as well is no evidence for an effect.
The best structures are then fitted whole, and ranked by the squared residuals plus the price of
their parameters (Bayesian information criterion: Schwarz, Annals of Statistics 6, 1978).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.experiment import Experiment
from ldt_core.base.threads import spread
from ldt_core.estimation.grey_box import COARSE_STEP, GreyBox
from ldt_core.estimation.grey_box_fit import (
    DIFFERENCE,
    GreyBoxFit,
    GreyBoxProblem,
    Prior,
    fit_grey_box,
)
from ldt_core.estimation.misfit import misfit
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.effect import Effect

Array = NDArray[np.float64]

#: Gauss-Newton steps of the screening; under the observer an effect is found in two or three.
SCREENING_STEPS = 4
#: Observer gains of the screening: all of the innovation, for what captures the shaft; a tenth, for
#: what is weak and lasts, which so many samples' noise would hide.
SCREENING_GAINS = (1.0, 0.1)
#: Structures of each screening that are fitted whole.
FINALISTS = 2
#: Effects of a structure; of what one experiment tells, more cannot be told apart.
MOST_EFFECTS = 4
#: Part of the squared error that the best structure removes under the observer: one that leaves
#: more than this of it is not fitted whole.
SERIOUS = 0.5


@dataclass(frozen=True, eq=False)
class FittedStructure:
    """A machine with effects, fitted.

    Attributes:
        box: machine and effects.
        fit: where the fit ended.
        prior: of the machine's coordinates, with which it began.
        score: squared residuals in noise deviations plus the price of the parameters; the least is
            the best. Structures that differ by less than `2 log(odds)` are not told apart.
    """

    box: GreyBox
    fit: GreyBoxFit
    prior: Prior
    score: float

    @property
    def names(self) -> tuple[str, ...]:
        """Of its effects."""
        return tuple(e.name for e in self.box.effects)

    @property
    def explains(self) -> bool:
        """Whether the residuals of all experiments are noise."""
        return all(misfit(r).explained for r in self.fit.residuals)

    def as_present(self, prior: Prior) -> Present:
        """Where a search for further effects goes on."""
        given = {e.name: values for e, values in self.box.values(self.fit.q)[1]}
        return Present(self.box.effects, given, prior)


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


class StructureSearch:
    """The structures of one machine, tried on some experiments.

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
        workers: int = 1,
    ) -> None:
        self.machine, self.tolerances = machine, tolerances
        self.experiments, self.noise, self.workers = list(experiments), noise, workers
        self._samples = sum(len(e) for e in experiments)

    def fitted(self, present: Present, effects: Sequence[Effect]) -> FittedStructure:
        """These effects with the machine's parameters, fitted whole."""
        box = GreyBox(self.machine, effects, self.tolerances)
        problem = self._problem(box, present.prior)
        known = {n: g for n, g in present.given.items() if n in {e.name for e in effects}}
        guesses = box.first_guesses({})
        if known:
            guesses += box.first_guesses(known)
        starts = [np.concatenate([present.prior.mean, g]) for g in guesses]
        fit = fit_grey_box(problem, starts)
        own = box.size - len(box.uncertain)
        return FittedStructure(box, fit, present.prior, fit.cost + own * math.log(self._samples))

    def search(self, present: Present, library: Sequence[Effect]) -> list[FittedStructure]:
        """The best structures, fitted whole, the best first.

        One effect more at a time, the values of the others being fitted along, until the residual
        is noise or nothing is gained.

        Args:
            present: to which effects are added, or which they replace.
            library: of effects that this machine can have.
        """
        found = self._with_one_more(present, library, bool(present.effects))
        while found and not found[0].explains:
            best = found[0]
            if len(best.box.effects) >= MOST_EFFECTS:
                break
            further = self._with_one_more(best.as_present(present.prior), library, False)
            if not further or further[0].score >= best.score:
                break
            found = sorted([*further, *found], key=lambda s: s.score)
        return found

    def _with_one_more(
        self, present: Present, library: Sequence[Effect], instead: bool
    ) -> list[FittedStructure]:
        """The present effects and one more, or also one in their place; the best first."""
        here = {e.name for e in present.effects}
        tried = [(*present.effects, e) for e in library if e.name not in here]
        if instead:
            tried += [(e,) for e in library]
        chosen: list[int] = []
        for gain in SCREENING_GAINS:
            costs = [math.inf] * len(tried)
            slopes = self._machine_slopes(present, gain)

            def screen(
                i: int, costs: list[float] = costs, slopes: Array = slopes, gain: float = gain
            ) -> None:
                costs[i] = self._screened(present, tried[i], slopes, gain)

            for _ in spread(screen, len(tried), self.workers):
                pass
            # What recovers less than half of what the best does is no rival of it.
            start = self._screened(present, present.effects, slopes, gain)
            limit = min(costs) + SERIOUS * max(start - min(costs), 0.0)
            best = np.argsort(costs, kind="stable")[:FINALISTS]
            chosen += [int(i) for i in best if costs[i] <= limit and i not in chosen]
        return sorted((self.fitted(present, tried[i]) for i in chosen), key=lambda s: s.score)

    def _problem(self, box: GreyBox, prior: Prior, workers: int | None = None) -> GreyBoxProblem:
        count = self.workers if workers is None else workers
        return GreyBoxProblem(box, self.experiments, self.noise, prior, workers=count)

    def _machine_slopes(self, present: Present, gain: float) -> Array:
        """Orthonormal basis of what the machine's own parameters change, prior rows below."""
        box = GreyBox(self.machine, present.effects, self.tolerances)
        k = len(box.uncertain)
        problem = self._problem(box, present.prior)
        x = problem.point(box.coordinates(present.given, present.prior.mean))
        rows = problem.rows(x, gain, COARSE_STEP)
        slopes = problem.slopes(x, rows, gain, COARSE_STEP)
        slopes = np.delete(slopes, np.arange(k, box.size), axis=1)
        root = np.linalg.cholesky(present.prior.precision) if k else np.zeros((0, 0))
        below = np.eye(slopes.shape[1])
        below[:k, :k] = root.T
        return np.linalg.qr(np.vstack([slopes, below]))[0]

    def _screened(
        self, present: Present, effects: Sequence[Effect], basis: Array, gain: float
    ) -> float:
        """Least squared residuals under the observer, the machine's parameters eliminated."""
        box = GreyBox(self.machine, effects, self.tolerances)
        problem = self._problem(box, present.prior, workers=1)
        k, below = len(box.uncertain), basis.shape[0]

        def projected(rows: Array) -> Array:
            padded = np.concatenate([rows, np.zeros(below - rows.size)])
            return padded - basis @ (basis.T @ padded)

        def rows_at(q: Array) -> Array:
            x = problem.point(np.concatenate([present.prior.mean, q]))
            return projected(problem.rows(x, gain, COARSE_STEP))

        known = {n: g for n, g in present.given.items() if n in {e.name for e in effects}}
        best, q = math.inf, np.zeros(box.size - k)
        rows = np.zeros(below)
        for guess in box.first_guesses(known):
            here = rows_at(guess)
            if float(here @ here) < best:
                best, q, rows = float(here @ here), guess, here
        low, high = box.low[k:], box.high[k:]
        for _ in range(SCREENING_STEPS):
            columns = np.empty((rows.size, q.size))
            for j in range(q.size):
                by = DIFFERENCE if q[j] + DIFFERENCE <= high[j] else -DIFFERENCE
                moved = q.copy()
                moved[j] += by
                columns[:, j] = (rows_at(moved) - rows) / by
            step = -np.linalg.lstsq(columns, rows, rcond=1e-9)[0]
            step /= max(1.0, float(np.abs(step).max(initial=0.0)))
            tried = np.clip(q + step, low, high)
            better = rows_at(tried)
            if not float(better @ better) < best:
                break
            best, q, rows = float(better @ better), tried, better
        return best + q.size * math.log(self._samples)
