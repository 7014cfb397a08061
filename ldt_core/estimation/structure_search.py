"""Which effects to add to a machine so that it explains an experiment: a search over structures.

Every effect of a library is tried, beside those that are there and in their place, under the
observer of `grey_box`, which needs few steps; then a further one beside the best, and so on. The
machine's uncertain parameters are eliminated to first order meanwhile, under their prior: what they
explain as well is no evidence for an effect.
The best structures are then fitted whole, and ranked by the squared residuals plus the price of
their parameters (Bayesian information criterion: Schwarz, Annals of Statistics 6, 1978).
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
from ldt_core.base.threads import spread
from ldt_core.estimation.grey_box import COARSE_STEP, GreyBox, Prior
from ldt_core.estimation.grey_box_fit import (
    DIFFERENCE,
    FIRST_ROUNDS,
    GreyBoxFit,
    GreyBoxProblem,
    fit_grey_box,
    of_first,
)
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.effect import Effect

#: Gauss-Newton steps of the screening; under the observer an effect is found in two or three.
SCREENING_STEPS = 4
#: Screenings, in turn until one explains: observer gain, and whether parameters that an effect
#: brings to life are fitted with it. All of the innovation is for what captures the shaft; a tenth,
#: for what is weak and lasts, which so many samples' noise would hide. Where parameters are off,
#: fitting finds what first order does not; under the weak observer, whose squared error has more
#: minima, it is the last resort.
SCREENINGS = ((1.0, True), (0.1, False), (0.1, True))
WEAKEST = min(gain for gain, _ in SCREENINGS)
#: Structures of each screening that are fitted whole, the best and its rival.
FINALISTS = 2
#: Effects of a structure: of what few experiments tell, more are rarely told apart.
MOST_EFFECTS = 3
#: Standard deviations of the cost of a fit to white noise, beyond which a prior is doubted: one fit
#: in 700 for nothing, which costs the time of another fit and no more.
SURPRISING = 3.0
#: Part of the squared error that the best structure removes under the observer: one that leaves
#: more than this of it is not fitted whole.
SERIOUS = 0.5
#: Times what an effect gains by itself, that it is hoped to gain beside others. What acts side by
#: side does not gain more together than the sum, but to first order only.
HOPED = 2.0


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
        return self.fit.explained

    @property
    def surprises(self) -> bool:
        """Whether white noise, and a prior that is right, would cost less than this fit."""
        count = sum(r.size for r in self.fit.residuals) + len(self.box.uncertain)
        return self.fit.cost > count + SURPRISING * math.sqrt(2 * count)

    @property
    def surprise(self) -> float:
        """-2 log of what the prior gives the data, but for what all priors have in common.

        Laplace's approximation (MacKay, "Bayesian interpolation", Neural Computation 4, 1992): a
        narrow prior is rewarded where it is right.
        """
        machine = of_first(self.fit.information, len(self.box.uncertain))
        told, before = (np.linalg.slogdet(m)[1] for m in (machine, self.prior.precision))
        return self.fit.cost + float(told - before)


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
    """

    cost: float
    given: dict[str, dict[str, float]]
    explains: bool


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
        # Squared error, values and innovations of what was screened with the machine eliminated.
        self._known: dict[tuple[float, str, tuple[str, ...]], tuple[float, Array, Array]] = {}

    @property
    def _most_noise(self) -> float:
        """Squared residuals in noise deviations that noise alone hardly ever has."""
        return self._samples + SURPRISING * math.sqrt(2 * self._samples)

    def fitted(
        self,
        present: Present,
        effects: Sequence[Effect],
        near: Array | None = None,
        sized: bool = True,
    ) -> FittedStructure:
        """These effects with the machine's parameters, fitted whole; see `fit_grey_box`."""
        box = GreyBox(self.machine, effects, self.tolerances)
        guesses = box.first_guesses(present.given, again=True)
        starts = [np.concatenate([present.prior.mean, g]) for g in guesses]
        return self._structure(box, present.prior, starts, near, sized)

    def refined(self, present: Present, near: Array) -> FittedStructure:
        """The present effects with the machine's parameters, fitted next to these coordinates."""
        box = GreyBox(self.machine, present.effects, self.tolerances)
        return self._structure(box, present.prior, (), near, sized=False)

    def _structure(
        self, box: GreyBox, prior: Prior, starts: Sequence[Array], near: Array | None, sized: bool
    ) -> FittedStructure:
        fit = fit_grey_box(self._problem(box, prior), starts, near=near, sized=sized)
        own = box.size - len(box.uncertain)
        return FittedStructure(box, fit, prior, fit.cost + own * math.log(self._samples))

    def search(self, present: Present, library: Sequence[Effect]) -> list[FittedStructure]:
        """The best structures, fitted whole, the best first.

        Effects are added one by one under the observer, the values of the others being estimated
        along, until the innovations are noise or nothing is gained. The weaker observer is asked
        only where what the stronger one found does not explain the experiments; see `SCREENINGS`.

        Args:
            present: to which effects are added, or which they replace.
            library: of effects that this machine can have.
        """
        found: list[FittedStructure] = []
        screened = 0.0
        for gain, jointly in SCREENINGS:
            if gain == screened and not self._machine_slopes(present, gain)[1].any():
                continue  # it would be the same again
            screened = gain
            led, grown = self._grown(present, library, gain, jointly)
            for new in grown:
                if all(set(new.effects) != set(other.box.effects) for other in found):
                    # What an observer cannot lead to noise hardly explains: its size will do, and
                    # there is no need of a rival.
                    found.append(self.fitted(new, new.effects, sized=led))
                if not led and not found[-1].explains:
                    break
            if any(structure.explains for structure in found):
                break
        found = sorted(found, key=lambda s: s.score)
        return [self.pruned(found[0]), *found[1:]] if found else []

    def pruned(self, found: FittedStructure) -> FittedStructure:
        """What explains, without the effects that do not pay the price of their parameters."""
        best = found
        while len(best.box.effects) > 1 and best.explains:
            given = {e.name: values for e, values in best.box.values(best.fit.q)[1]}
            fewer = [
                self.fitted(Present(rest, given, best.prior), rest, sized=False)
                for rest in itertools.combinations(best.box.effects, len(best.box.effects) - 1)
            ]
            least = min(fewer, key=lambda s: s.score)
            if least.score > best.score:
                break
            best = least
        return best

    def _grown(
        self, present: Present, library: Sequence[Effect], gain: float, jointly: bool
    ) -> tuple[bool, list[Present]]:
        """The best structure under an observer of this gain, and the rival of its last effect.

        And whether the best leaves noise. A stronger observer than the weakest is not asked where
        it leaves noise without any effect: the cause is one that it hides.
        """
        found: list[Present] = []
        led = False
        while len(present.effects) < MOST_EFFECTS:
            here = {e.name for e in present.effects}
            tried = [(*present.effects, e) for e in library if e.name not in here]
            if not found:  # and other ones in the place of those that were there
                tried += [(e,) for e in library if here]
            basis, silent = self._machine_slopes(present, gain)
            silent &= jointly
            before = self._screened(present, present.effects, basis, gain, silent)
            if not found and before.explains and gain > WEAKEST:
                break

            def screen(
                i: int,
                tried: Sequence[tuple[Effect, ...]] = tried,
                present: Present = present,
                basis: Array = basis,
                silent: NDArray[np.bool_] = silent,
            ) -> Screened:
                return self._screened(present, tried[i], basis, gain, silent)

            results = list(spread(screen, len(tried), self.workers))
            order = sorted(range(len(tried)), key=lambda i: results[i].cost)
            best = results[order[0]]
            if not best.cost < before.cost:
                break
            # What recovers less than half of what the best does is no rival of it.
            limit = best.cost + SERIOUS * (before.cost - best.cost)
            found = [
                Present(tried[i], results[i].given, present.prior)
                for i in order[:FINALISTS]
                if results[i].cost <= limit
            ]
            led = best.explains
            if led or self._hopeless(present, before, [results[i] for i in order]):
                break
            present = found[0]
        return led, found

    def _hopeless(self, present: Present, before: Screened, ranked: Sequence[Screened]) -> bool:
        """Whether further effects cannot be hoped to gain what is missing.

        Beside a first one each is hoped to gain what that did: an unbalance that captures the shaft
        hides what else acts. Beside more, what it would have gained in the place of the last one.
        """
        left = MOST_EFFECTS - len(present.effects) - 1
        others = ranked[1 : 1 + left] if present.effects else [ranked[0]] * left
        gains = sum(before.cost - other.cost for other in others)
        return ranked[0].cost - HOPED * gains > self._most_noise

    def _problem(self, box: GreyBox, prior: Prior, workers: int | None = None) -> GreyBoxProblem:
        count = self.workers if workers is None else workers
        return GreyBoxProblem(box, self.experiments, self.noise, prior, workers=count)

    def _machine_slopes(self, present: Present, gain: float) -> tuple[Array, NDArray[np.bool_]]:
        """What the machine's own parameters change, prior rows below, and which change nothing.

        An orthonormal basis; and (k,) those that the present effects leave without any effect, as
        a foundation is that nothing shakes.
        """
        box = GreyBox(self.machine, present.effects, self.tolerances)
        k = len(box.uncertain)
        problem = self._problem(box, present.prior)
        x = problem.point(box.coordinates(present.given, present.prior.mean))
        rows = problem.rows([x], gain, COARSE_STEP)[0]
        slopes = problem.slopes(x, rows, gain, COARSE_STEP)
        slopes = np.delete(slopes, np.arange(k, box.size), axis=1)
        root = np.linalg.cholesky(present.prior.precision) if k else np.zeros((0, 0))
        below = np.eye(slopes.shape[1])
        below[:k, :k] = root.T
        silent = ~np.any(slopes[:, :k], axis=0)
        return np.linalg.qr(np.vstack([slopes, below]))[0], silent

    def _screened(
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
        problem = self._problem(box, present.prior, workers=1)
        k = len(box.uncertain)
        asked = gain, repr(present.given), tuple(e.name for e in effects)
        if asked not in self._known:
            self._known[asked] = self._eliminated(present, problem, basis, gain)
        best, q, rows = self._known[asked]
        if silent.any():
            x = problem.point(np.concatenate([present.prior.mean, q]))
            woken = x.copy()
            woken[:k][silent] += DIFFERENCE
            asleep, awake = problem.rows([x, woken], gain, COARSE_STEP)
            if np.any(awake != asleep):
                joint, cost, _ = problem.descend(x, gain, COARSE_STEP, FIRST_ROUNDS)
                if cost < best:
                    best, q = cost, joint[k : box.size]
                    rows = problem.rows([joint], gain, COARSE_STEP)[0]
        given = {e.name: values for e, values in box.values(np.concatenate([np.zeros(k), q]))[1]}
        ends = np.cumsum([int(kept.sum()) for kept in problem.keep])
        parts = np.split(rows[: ends[-1]], ends[:-1])
        explains = problem.noise_alone(parts, problem.noise)
        return Screened(best + q.size * math.log(self._samples), given, explains)

    def _eliminated(
        self, present: Present, problem: GreyBoxProblem, basis: Array, gain: float
    ) -> tuple[float, Array, Array]:
        """Squared error, effects' coordinates, and rows, the machine's parameters eliminated."""
        box = problem.box
        k, below = len(box.uncertain), basis.shape[0]

        def projected(rows: Array) -> Array:
            padded = np.concatenate([rows, np.zeros(below - rows.size)])
            return padded - basis @ (basis.T @ padded)

        def rows_at(tried: Sequence[Array]) -> list[Array]:
            points = [problem.point(np.concatenate([present.prior.mean, q])) for q in tried]
            return [projected(rows) for rows in problem.rows(points, gain, COARSE_STEP)]

        best, q = math.inf, np.zeros(box.size - k)
        rows = np.zeros(below)
        guesses = box.first_guesses(present.given)
        for guess, here in zip(guesses, rows_at(guesses), strict=True):
            if float(here @ here) < best:
                best, q, rows = float(here @ here), guess, here
        low, high = box.low[k:], box.high[k:]
        moved: list[Array] = []
        for _ in range(SCREENING_STEPS):
            by = np.where(q + DIFFERENCE <= high, DIFFERENCE, -DIFFERENCE)
            moved = moved or rows_at([q + step for step in np.diag(by)])
            columns = np.empty((rows.size, q.size))
            for j, there in enumerate(moved):
                columns[:, j] = (there - rows) / by[j]
            step = -np.linalg.lstsq(columns, rows, rcond=1e-9)[0]
            step /= max(1.0, float(np.abs(step).max(initial=0.0)))
            tried = np.clip(q + step, low, high)
            # With what the next step needs: it takes lanes that would be left over.
            by = np.where(tried + DIFFERENCE <= high, DIFFERENCE, -DIFFERENCE)
            better, *moved = rows_at([tried, *(tried + step for step in np.diag(by))])
            if not float(better @ better) < best:
                break
            best, q, rows = float(better @ better), tried, better
        return best, q, rows
