"""The sets of effects that explain a recording best, one, two and three at a time.

A scout works on a few experiments: every effect alone, then the pairs and triples that the
responses' inner products promise, each fitted. Its best sets of every size are fitted again on all
experiments.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.effect_fit import STEPS, EffectFit, fit
from ldt_core.diagnosis.error_band import ErrorBand
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.model_selection import FittedSets, Names, plain_enough
from ldt_core.diagnosis.nominal_prior import NominalPrior
from ldt_core.diagnosis.quick_fits import STEPS as QUICK_STEPS
from ldt_core.diagnosis.quick_fits import QuickFits, TriedSet, prior_weight
from ldt_core.diagnosis.responses import best_alone, rank_pairs, simulate_all
from ldt_core.diagnosis.scouting import empty, of_each_kind, scouted, told
from ldt_core.diagnosis.thresholds import THRESHOLDS

# Which sets are tried. They save time: everything else would be tried in vain.
PAIRS = 5  # pairs fitted, those whose responses promise most
BASES = 2  # sets of one size that larger ones are built upon
EXCHANGES = 2  # rounds in which the members of the best set are exchanged
ENABLED_STARTS = 200  # simulations of a pair of which one effect shows only beside the other
ENABLED = 3  # of these from which such a pair is fitted
STARTS_BESIDE = 4  # of an effect that is simulated beside a set
SIZE_TRIED_ANYWAY = 3  # effects: sets up to this size are tried even where the last did not help
FAR_OFF = 0.3  # of the gap: a fit that leaves more is not worth going on with
# Which sets are fitted on all experiments.
FINISHED = 2  # sets of each size; those that compete with the answer come at the end
FINISHED_PLAINER = 1  # further sets of each size, with fewer parameters
FINISHED_RIVALS = 6  # sets that differ from the chosen one in one member
BEHIND = 1.5  # times the power that the best of a size leaves: a set further behind is not fitted
MANY_PARAMETERS = 3  # with which a fit may end before its best
UNFINISHED = 0.005  # of the gap: a fit with many parameters that leaves more goes on
UNFINISHED_STEPS = 30  # least-squares steps for which it goes on
MOST_WORK = 6e7  # samples simulated, after which no further set is sought: 15 to 50 s


class EffectSetSearch:
    """The search on one residuals.

    Args:
        prior: of the machine's own parameters that are not known for certain: they are fitted with
            every set under it, and never named.
    """

    def __init__(
        self,
        residuals: FreeRunResiduals,
        candidates: Sequence[Candidate],
        tick: Callable[[str], None] = lambda doing: None,
        prior: NominalPrior | None = None,
    ) -> None:
        self.residuals, self.candidates, self.tick = residuals, tuple(candidates), tick
        #: Effect to those that this recording cannot tell from it, whatever the data are.
        self.twins: dict[str, set[str]] = {}
        self._extended: set[Names] = {frozenset()}  # `_alone` tries all
        # Its fits run side by side: over so few experiments each of them could not be spread well.
        self.scout, self.workers = residuals.part(scouted(residuals), workers=1), residuals.workers
        #: Coordinates of the prior that take part in the fits.
        self.told = [] if prior is None else told(self.scout, prior, residuals.size)
        part = prior.among(self.told) if prior and self.told else None
        self.own: tuple[Candidate, ...] = () if part is None else (part.candidate(),)
        zeros = [np.zeros(len(c)) for c in self.own]
        count = len(self.own)
        fitted = fit(self.scout, self.own, zeros, own=count) if count else None
        self.responses = simulate_all(
            self.scout, self.candidates, lambda: tick("simulating effects"), fitted, self.workers
        )
        alone = fit(residuals, self.own, fitted.z, own=count) if fitted else empty(residuals)
        self.found = FittedSets(residuals, ErrorBand(residuals), alone.residual, self.responses)
        # Without any effect: the machine's own parameters alone.
        self.found.fits[frozenset()] = alone
        self.found.scouted[frozenset()] = fitted or empty(self.scout)
        self.band = ErrorBand(self.scout)
        #: Of a deviation of the machine file's numbers beside one of the noise.
        self.weight = prior_weight(self.found.excess)
        none = self.found.scouted[frozenset()]
        first = [np.zeros(len(c)) if c.steady else z for c, z in zip(self.own, none.z, strict=True)]
        excess = self.band.excess(none.residual)
        self.quick = QuickFits(self.scout, self.own, first, excess, self.workers, tick)

    @property
    def spent(self) -> bool:
        """Whether the search has done all the work that it may do."""
        return self.residuals.work.samples > MOST_WORK

    def run(self) -> FittedSets:
        """Fit sets of one effect, then of two and three as long as something is left.

        Larger sets are built only on a triple that a pair could not replace.
        """
        enough = self.band.limit_of(THRESHOLDS.remainder_false_alarm)
        self._alone()
        bases = BASES
        for count in range(1, THRESHOLDS.largest_set + 1):
            if count == 2:
                self._pairs()
            if count > 1:
                self._build_on(count - 1, bases)
                if not self._best(count):  # no candidate is left that shows
                    break
                self._exchange(count, enough)
            self._finish(count)
            best = self._best(count)
            if self.spent or not best or self.band.excess(best[0].residual) < enough:
                break
            if count > 1 and not self._gained(count):
                bases = 1
            tried = SIZE_TRIED_ANYWAY if self._room_for_more(best[0]) else 2
            if count >= tried and not self._gained(count):
                break
        return self.found

    def _room_for_more(self, best: EffectFit) -> bool:
        """Whether a set leaves so much that a further effect could be named by its own part."""
        left, gap = self.band.excess(best.residual), self.band.excess(self.responses.base)
        return left > THRESHOLDS.further_effect_of_gap * gap

    def _gained(self, count: int) -> bool:
        """Whether the best set of a size takes away half of what the best smaller one leaves."""
        now, before = self._best(count)[0], self._best(count - 1)[0]
        left = max(self.band.excess(before.residual), 0.0)
        return before.loss - now.loss > THRESHOLDS.further_effect_of_remainder * left

    def _alone(self) -> None:
        tries = [
            TriedSet([c], [start])
            for i, c in enumerate(self.candidates)
            for start in best_alone(self.responses, i)
        ]
        none = self.found.scouted[frozenset()]
        turned = self.responses.with_free_phase
        ranked = self.responses.promised_beside(none) if turned else ()
        tries += [TriedSet([c], [start]) for c, start, _ in ranked if c.name in turned]
        self._scout(self.quick.race(tries, len(self.candidates)))

    def _pairs(self) -> None:
        ranked = sorted(rank_pairs(self.responses).items(), key=lambda q: -q[1][0])
        z, c = self.responses.z, self.candidates
        tries = [TriedSet([c[i], c[j]], [z[k], z[m]]) for (i, j), (_, k, m) in ranked[:PAIRS]]
        self._scout(() if self.spent else tries)
        if not self.spent:
            self._scout(self._enabled())

    def _enabled(self) -> list[TriedSet]:
        """Pairs of which one effect shows only beside the other, such as a foundation's."""
        shown = set(self.responses.owner.tolist())
        silent = [c for i, c in enumerate(self.candidates) if i not in shown]
        none = self.found.scouted[frozenset()].use
        tries = []
        for other in (c for i, c in enumerate(self.candidates) if i in shown):
            beside = [(other.effect, other.typical), *none]
            uses = [[(c.effect, c.typical), *beside] for c in silent]
            base, *moved = self.scout.of_all([beside, *uses])
            for c, rest in zip(silent, moved, strict=True):
                if float(np.sum((rest - base) ** 2)) < THRESHOLDS.visible_change:
                    continue
                grid = [(a, b) for a in other.starts() for b in c.starts()]
                grid = grid[:: -(-len(grid) // ENABLED_STARTS)]
                runs = self.scout.of_all(
                    [
                        [(other.effect, other.given(a)), (c.effect, c.given(b)), *none]
                        for a, b in grid
                    ]
                )
                self.tick("simulating effects")
                best = np.argsort([float(r @ r) for r in runs])[:ENABLED]
                tries += [TriedSet([other, c], grid[k]) for k in best]
        return tries

    def _build_on(self, count: int, bases: int) -> None:
        for base in of_each_kind(self._best(count))[:bases]:
            self._extend(base)

    def _extend(self, base: EffectFit) -> None:
        """Scout a set with each other effect that a race leaves, once."""
        names = frozenset(base.names)
        if not self.spent and names not in self._extended:
            self._extended.add(names)
            self._scout(self.quick.race(self.additions(base)))

    def _exchange(self, count: int, enough: float) -> None:
        """Try others in the place of each member of the best set, until that gains nothing.

        What promised most at first may have stood for something that is found only beside others.
        """
        for _ in range(EXCHANGES):
            best = self._best(count)[0]
            if self.band.excess(best.residual) < enough:
                break
            for leave in range(count):
                self._extend(self._without(best, leave))
            if self.spent or self._best(count)[0] is best:
                break
        self._prune(self._best(count)[0])

    def _prune(self, best: EffectFit) -> None:
        """Fit what is left of a set without each of its members, from where the whole set ended.

        A further member may have helped a fit out of a poor minimum, and be of no use there.
        """
        tries, count = [], len(best.effects)
        for leave in range(count):
            kept = [i for i in range(count) if i != leave]
            tries.append(TriedSet([best.effects[i] for i in kept], [best.z[i] for i in kept]))
        self._scout(tries)
        self._finish(count - 1)

    def _without(self, base: EffectFit, leave: int) -> EffectFit:
        """A scouted set without one of its members, scouted as well."""
        kept = [i for i in range(len(base.effects)) if i != leave]
        names = frozenset(base.effects[i].name for i in kept)
        if names not in self.found.scouted:
            self._scout([TriedSet([base.effects[i] for i in kept], [base.z[i] for i in kept])])
        return self.found.scouted[names]

    def additions(self, base: EffectFit) -> list[TriedSet]:
        """A set with each other effect, begun where that promises most.

        An effect that shows only together with another one is simulated beside the set.
        """
        shown = {self.candidates[i].name for i in self.responses.owner.tolist()}
        silent = [c for c in self.candidates if c.name not in shown.union(base.names)]
        ranked = self.responses.promised_beside(base)
        if silent:
            begun = self.responses.promising(base, STARTS_BESIDE)
            tick = lambda: self.tick("simulating effects")  # noqa: E731
            beside = simulate_all(self.scout, silent, tick, base, self.workers, begun)
            ranked += beside.promised_beside(base)
        return [self._with(base, candidate, start) for candidate, start, _ in ranked]

    def _with(self, base: EffectFit, candidate: Candidate, start: Array) -> TriedSet:
        """A scouted set and one more effect.

        The start angles are sought beside those of the set, but not where the effect depends on
        them more than the machine does itself.
        """
        if self.scout.shaking:
            turned = any(p.unit == "rad" for p in candidate.parameters)
        else:
            turned = self.scout.angular([candidate.effect])
        members = [*base.effects, candidate]
        known = None if turned else base.starts
        count = len(base.effects)
        return TriedSet(members, [*base.z[:count], start], known, base.z[count:])

    def _scout(self, tries: Sequence[TriedSet]) -> list[EffectFit]:
        """Fit sets on a few experiments, side by side; the best of each set so far."""
        names = []
        for tried in self.quick.fitted(tries):
            names.append(frozenset(tried.names))
            before = self.found.scouted.get(names[-1])
            if before is None or tried.loss < before.loss:
                self.found.scouted[names[-1]] = tried
                if before is not None and before.loss - tried.loss > THRESHOLDS.chance_gain:
                    self.found.fits.pop(names[-1], None)  # it ended in a poor minimum
        return [self.found.scouted[n] for n in names]

    def _best(self, count: int) -> list[EffectFit]:
        found = [f for names, f in self.found.scouted.items() if len(names) == count]
        return sorted(found, key=lambda f: f.loss)

    def _finish(self, count: int) -> None:
        """Fit the scout's best sets of a size on all experiments."""
        best = self._best(count)
        if not best:
            return
        near = [f for f in best if self._near(f, best[0])][:FINISHED]
        plain = [f for f in best if f not in near and self._plainer(f, best[0])][:FINISHED_PLAINER]
        for f in (*near, *plain):
            self.finish(f)

    def _near(self, scouted: EffectFit, best: EffectFit) -> bool:
        return scouted.loss - best.loss <= self._reach(self.band, best)

    @staticmethod
    def _reach(band: ErrorBand, best: EffectFit) -> float:
        """Loss up to which a set behind the best may still turn out to be the better one."""
        return BEHIND * max(band.excess(best.residual), 0.0) + THRESHOLDS.chance_gain

    def _plainer(self, scouted: EffectFit, best: EffectFit) -> bool:
        """Whether a set with fewer parameters might be preferred to another one."""
        gap = self.found.scouted[frozenset()].loss - best.loss
        return plain_enough(scouted, best, scouted.loss - best.loss, gap)

    def finish(self, scouted: EffectFit) -> EffectFit:
        """The same set, fitted on all experiments."""
        names = frozenset(scouted.names)
        if names not in self.found.fits:
            self.tick("fitting the best sets on all experiments")
            if self.scout.size == self.residuals.size:
                self.found.fits[names] = scouted
            else:
                steps = QUICK_STEPS if self.spent else STEPS
                self.found.fits[names] = fit(
                    self.residuals,
                    scouted.members,
                    scouted.z,
                    steps=steps,
                    own=len(self.own),
                    weight=self.weight,
                )
            self._polish(names)
        return self.found.fits[names]

    def _polish(self, names: Names) -> None:
        """Go on with a fit that may have ended before its many parameters were at their best.

        Not with one that is far behind another of its size.
        """
        found, band = self.found.fits[names], self.found.band
        left, whole = band.excess(found.residual), self.found.excess
        best = min(self.found.of_size(len(names)), key=lambda f: f.loss, default=found)
        behind = found.loss - best.loss > self._reach(band, best)
        if (
            found.free < MANY_PARAMETERS
            or behind
            or self.spent
            or not UNFINISHED * whole < left < FAR_OFF * whole
        ):
            return
        more = fit(
            self.residuals,
            found.members,
            found.z,
            steps=UNFINISHED_STEPS,
            own=len(self.own),
            known=found.starts,
            weight=self.weight,
        )
        self.found.fits[names] = min(found, more, key=lambda f: f.loss)

    def subset(self, base: EffectFit, names: Sequence[str]) -> EffectFit:
        """A part of a set, fitted on all experiments."""
        wanted = frozenset(names)
        if wanted not in self.found.scouted:
            chosen = [i for i, m in enumerate(base.effects) if m.name in wanted]
            self._scout([TriedSet([base.members[i] for i in chosen], [base.z[i] for i in chosen])])
        return self.finish(self.found.scouted[wanted])

    def alternatives(self, base: EffectFit) -> list[EffectFit]:
        """Sets that differ from a set in one member, the most promising, fitted on all."""
        names = frozenset(base.names)
        for leave, member in enumerate(base.effects):
            rest = self._without(base, leave)
            self._extend(rest)
            # What no recording tells from a member is tried whatever it costs.
            twins = self.twins.get(member.name, set()) - names
            if twins:
                tries = [t for t in self.additions(rest) if twins & t.names]
                self._scout([t for t in tries if t.names not in self.found.scouted])
        scouted = self.found.scouted.get(names, base)
        same = [f for f in self._best(len(names)) if len(names - set(f.names)) == 1]
        close = [f for f in same if self._near(f, scouted) or self._plainer(f, scouted)]
        return [self.finish(f) for f in close[:FINISHED_RIVALS]]
