"""Fits of sets of effects: many on a few experiments, the best of them on all.

The few are the scout's. Its fits rank the sets; the best of each size are fitted again on all
experiments, and those compete to be the answer.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.threads import spread
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.effect_fit import (
    START_STATE_GAIN,
    START_STATE_ROUNDS,
    STEPS,
    EffectFit,
    fit,
)
from ldt_core.diagnosis.error_band import ErrorBand
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.law_departure import LawDepartures
from ldt_core.diagnosis.model_selection import FittedSets, Names, plain_enough
from ldt_core.diagnosis.nominal_prior import NominalCandidate, NominalPrior
from ldt_core.diagnosis.responses import Responses, simulate_all
from ldt_core.diagnosis.ripple_orders import ORDER, Ripple, begun_at, ripple_orders
from ldt_core.diagnosis.scouting import bearable, empty, scouted, told
from ldt_core.diagnosis.simulated_experiments import StartStates
from ldt_core.diagnosis.thresholds import THRESHOLDS

# The scout: the fits on a few experiments.
SCOUT_STEPS = 8  # least-squares steps of its fits: a ranking needs no more
SCOUT_PRECISION = 1e-4  # of the loss, where its fits end
SETTLED = 3  # sets of a size whose start states are sought until they stand
AT_ONCE = 16  # fits between two looks at the work done: the same sets for any number of threads
# Which sets are fitted on all experiments.
COMPARED = 6  # sets of a size of which it is asked how far their laws may depart
FINISHED = 2  # sets of each size; those that compete with the answer come at the end
FINISHED_PLAINER = 1  # further sets of each size, with fewer parameters
HIDDEN = 1.5  # times the power left in those looked at: what another experiment leaves
BEHIND = 1.5  # times the power that the best of a size leaves: a set further behind is not fitted
MANY_PARAMETERS = 3  # with which a fit may end before its best
UNFINISHED = 0.005  # of the gap: a fit with many parameters that leaves more goes on
UNFINISHED_STEPS = 30  # least-squares steps for which it goes on
MOST_WORK = 6_000_000_000  # integration steps, some minutes: then no further set is sought
FAR_OFF = 0.3  # of the loss: with more left, a set is far from any answer


class TriedSet(NamedTuple):
    """A set of effects, where its fit is to begin, and the start states that are nearly its own."""

    members: Sequence[Candidate]
    start: Sequence[Array]
    known: StartStates | None = None

    def by_name(self) -> TriedSet:
        """The same in the order of its names, in which sets are fitted."""
        order = sorted(range(len(self.members)), key=lambda i: self.members[i].name)
        members, start = [self.members[i] for i in order], [self.start[i] for i in order]
        return TriedSet(members, start, self.known)


class SetFits:
    """Fits of sets of effects on one residuals.

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
        #: Effects whose laws are taken in detail, to where the fit of the details begins.
        self.in_detail: dict[str, Array] = {}
        self.workers = residuals.workers
        self.prior = prior
        self._look(residuals.of())

    def _look(self, rest: Array) -> None:
        """Begin, with the scout's experiments chosen by these (size,) residuals."""
        residuals, tick = self.residuals, self.tick
        # Its fits run side by side: over so few experiments each of them could not be spread well.
        self.looked = scouted(residuals, rest)
        parts = [residuals.experiments[i].part(begin, stop) for i, begin, stop in self.looked]
        self.scout = residuals.of_only(parts, workers=1)
        self._told = self._told_beside()
        own = self.own(())
        zeros = [np.zeros(len(c)) for c in own]
        count = len(own)
        fitted = fit(self.scout, own, zeros, own=count) if count else None
        ripples = self.ripples(fitted or empty(self.scout))
        self.responses = simulate_all(
            self.scout,
            self.candidates,
            lambda: tick("simulating effects"),
            fitted,
            self.workers,
            lambda c: [*c.starts(), *begun_at(c, ripples, c.effect.search.get(ORDER, ()))],
        )
        alone = fit(residuals, own, fitted.z, own=count) if fitted else empty(residuals)
        self.found = FittedSets(residuals, ErrorBand(residuals), alone.residual, self.responses)
        # Without any effect: the machine's own parameters alone.
        self.found.fits[frozenset()] = alone
        self.found.scouted[frozenset()] = fitted or empty(self.scout)
        #: What the other effects do beside a scouted set.
        self.beside: dict[EffectFit, Responses] = {}
        #: Where each set's fits on the scout's experiments ended; without their rows.
        self.ends: dict[Names, list[EffectFit]] = {}
        self.band = ErrorBand(self.scout)
        self.departures = LawDepartures(self.scout, self.responses.base)

    def ripples(self, base: EffectFit) -> list[Ripple]:
        """What goes up and down with the angle in what a scouted set leaves, strongest first."""
        return ripple_orders(self.scout, base.residual, base.starts or self.scout.starts)

    def _told_beside(self) -> dict[str, frozenset[int]]:
        """Coordinates of the prior that this recording tells of: of "", and beside each effect."""
        if self.prior is None:
            return {"": frozenset()}
        asked, size = len(self.prior.candidate()), self.residuals.size
        found = {"": frozenset(told(self.scout, self.prior, size))}
        silent = [j for j in range(asked) if j not in found[""]]
        for c in self.candidates if silent else ():
            use = [(c.effect, c.typical)]
            found[c.name] = frozenset(told(self.scout, self.prior, size, use, silent))
        return found

    def own(self, members: Sequence[Candidate]) -> tuple[NominalCandidate, ...]:
        """The machine's own parameters that are fitted with a set, as one candidate or none."""
        names = ["", *(c.name for c in members)]
        columns = frozenset().union(*(self._told.get(n, frozenset()) for n in names))
        if self.prior is None or not columns:
            return ()
        return (self.prior.among(sorted(columns)).candidate(),)

    def _own_start(self, own: Sequence[NominalCandidate]) -> list[Array]:
        """Where their fit begins: at the file's values, or as they were fitted without effects.

        Alone, those that are known well went as far as they may; beside a cause they need not.
        """
        none = self.found.scouted[frozenset()]
        found = []
        for c in own:
            z = np.zeros(len(c))
            if none.own and not c.steady:
                alone = dict(zip(none.own_columns, none.z[-1], strict=True))
                z = np.array([alone.get(j, 0.0) for j in c.columns])
            found.append(z)
        return found

    @property
    def spent(self) -> bool:
        """Whether the search has done all the work that it may do."""
        return self.residuals.work.steps > MOST_WORK

    def _scout(self, tries: Sequence[TriedSet], whatever: bool = False) -> list[EffectFit]:
        """Fit sets on a few experiments, side by side; the best of each set so far.

        Args:
            whatever: work that costs.
        """

        def work(first: int, k: int) -> EffectFit:
            members, start, known = self._with_details(tries[first + k]).by_name()
            own = self.own(members)
            begun = [*members, *own], [*start, *self._own_start(own)]
            steps, least, count = SCOUT_STEPS, SCOUT_PRECISION, len(own)
            return fit(self.scout, *begun, steps=steps, precision=least, own=count, known=known)

        names: list[Names] = []
        while len(names) < len(tries) and (whatever or not (names and self.spent)):
            part = functools.partial(work, len(names))
            for tried in spread(part, min(AT_ONCE, len(tries) - len(names)), self.workers):
                part_done = min(self.residuals.work.steps / MOST_WORK, 1.0)
                self.tick(f"fitting sets of effects, {part_done:.0%} of the most work")
                names.append(frozenset(tried.names))
                end = replace(tried, residual=tried.residual[:0], jacobian=tried.jacobian[:0])
                self.ends.setdefault(names[-1], []).append(end)
                before = self.found.scouted.get(names[-1])
                if before is None or tried.loss < before.loss:
                    self.found.scouted[names[-1]] = tried
                    if before and before.loss - tried.loss > THRESHOLDS.chance_gain:
                        self.found.fits.pop(names[-1], None)  # it ended in a poor minimum
        return [self.found.scouted[n] for n in names]

    def _with_details(self, tried: TriedSet) -> TriedSet:
        """The set with each law in detail that is to be taken so."""
        members, start = list(tried.members), list(tried.start)
        for i, (c, z) in enumerate(zip(tried.members, tried.start, strict=True)):
            detailed = c.detailed if c.name in self.in_detail else None
            if detailed is not None:
                members[i], start[i] = detailed, np.concatenate([z, self.in_detail[c.name]])
        return TriedSet(members, start, tried.known)

    def _best(self, count: int) -> list[EffectFit]:
        """Scouted sets of a size, the best first; those near the best once laws may depart."""
        found = [f for names, f in self.found.scouted.items() if len(names) == count]
        found = sorted(found, key=lambda f: f.loss)
        near = [f for f in found[:COMPARED] if self.near(f, found[0])]
        near = sorted(near, key=lambda f: f.loss - self.departures.taken(f))
        return [*near, *(f for f in found if f not in near)]

    def _settle(self, count: int) -> None:
        """Go on with the best sets of a size where a foundation's motion at the start is sought.

        Parameters and start states follow each other, a little in each round.
        """
        for _ in range(START_STATE_ROUNDS if self.scout.shaking and not self.spent else 0):
            before = self._best(count)[:SETTLED]
            self._scout([TriedSet(f.effects, f.z[: len(f.effects)], f.starts) for f in before])
            now = [self.found.scouted[frozenset(f.names)] for f in before]
            if all(
                b.loss < (1 + START_STATE_GAIN) * a.loss for a, b in zip(now, before, strict=True)
            ):
                break

    def _finish(self, count: int) -> None:
        """Fit the scout's best sets of a size on all experiments."""
        best = self._best(count)
        if not best:
            return
        near = [f for f in best if self.near(f, best[0])][:FINISHED]
        plain = [f for f in best if f not in near and self._plainer(f, best[0])][:FINISHED_PLAINER]
        for f in (*near, *plain):
            self.finish(f)
        # What the few experiments liked best may explain nothing else.
        further = [f for f in best if f not in near and f not in plain][:FINISHED]
        while further and not self.spent and self._fails_elsewhere(best[0]):
            self.finish(further.pop(0))

    def _fails_elsewhere(self, liked: EffectFit) -> bool:
        """Whether the best set on all leaves much, and what the scout likes best far less there."""
        found, band = self.found, self.found.band
        left = found.of_size(len(liked.names))[:1]
        if not left:
            return True
        promised = self.band.excess(liked.residual)
        part = max(promised, 0.0) / self.band.excess(self.responses.base)
        whole = band.excess(left[0].residual) / band.excess(found.base)
        return whole > HIDDEN * part + THRESHOLDS.further_effect_of_gap

    def leaves_noise(self, scouted: EffectFit) -> bool:
        """Whether a scouted set leaves no more than noise may."""
        limit = self.band.limit_of(THRESHOLDS.remainder_false_alarm)
        return self.band.excess(scouted.residual) < limit

    def near(self, scouted: EffectFit, best: EffectFit) -> bool:
        """Whether a scouted set may still turn out to be better than the best of its size."""
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
            fitted = scouted
            if self.scout.size != self.residuals.size:
                steps = SCOUT_STEPS if self.spent else STEPS
                begun = bearable(self.residuals, scouted, self.found.base)
                fitted = fit(self.residuals, scouted.members, begun, steps=steps, own=scouted.own)
            self.found.fits[names] = self._no_worse_than_parts(fitted)
            self._polish(names)
        return self.found.fits[names]

    def _no_worse_than_parts(self, fitted: EffectFit) -> EffectFit:
        """The set, fitted once more from where a part of it ended that leaves less.

        With an effect more a fit can leave no more, if it does not go astray: an angle that a
        ripple begins with, say, has many minima.
        """
        names, known = frozenset(fitted.names), self.found.fits
        parts = [known[names - {n}] for n in fitted.names if known.get(names - {n})]
        best = min(parts, key=lambda f: f.loss, default=fitted)
        if best.loss >= fitted.loss or not best.effects or self.spent:
            return fitted
        ends = dict(zip(best.names, best.z, strict=False))
        start = [ends.get(c.name, z) for c, z in zip(fitted.members, fitted.z, strict=True)]
        if any(len(a) != len(b) for a, b in zip(start, fitted.z, strict=True)):
            return fitted  # of which a law was taken in detail
        again = fit(self.residuals, fitted.members, start, own=fitted.own, known=best.starts)
        return min(fitted, again, key=lambda f: f.loss)

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
            own=found.own,
            known=found.starts,
        )
        self.found.fits[names] = min(found, more, key=lambda f: f.loss)

    def as_far_as(self, base: EffectFit, tried: TriedSet) -> None:
        """Fit a set on all experiments from where one ended that no data tell from it.

        Of two that are one, either may have ended in a poor minimum.
        """
        members, start, _ = tried.by_name()
        names, count = frozenset(c.name for c in members), len(members)
        before = self.found.fits.get(names)
        if before and before.loss - base.loss < THRESHOLDS.chance_gain:
            return
        begun = [*members, *base.members[count:]], [*start, *base.z[count:]]
        more = fit(self.residuals, *begun, own=base.own, known=base.starts)
        if before is None or more.loss < before.loss:
            self.found.fits[names] = more

    def _without(self, base: EffectFit, leave: int) -> EffectFit:
        """A scouted set without one of its members, scouted as well."""
        kept = [i for i in range(len(base.effects)) if i != leave]
        names = frozenset(base.effects[i].name for i in kept)
        if names not in self.found.scouted:
            self._scout([TriedSet([base.effects[i] for i in kept], [base.z[i] for i in kept])])
        return self.found.scouted[names]

    def _with(self, base: EffectFit, candidate: Candidate, start: Array) -> TriedSet:
        """A scouted set and one more effect.

        The start angles are sought beside those of the set, but not where the effect depends on
        them more than the machine does itself.
        """
        if self.scout.shaking:
            turned = any(p.cyclic for p in candidate.parameters)
        else:
            turned = self.scout.angular([candidate.effect])
        members = [*base.effects, candidate]
        known = None if turned else base.starts
        return TriedSet(members, [*base.z[: len(base.effects)], start], known)

    def subset(self, base: EffectFit, names: Sequence[str]) -> EffectFit:
        """A part of a set, fitted on all experiments."""
        wanted = frozenset(names)
        if wanted not in self.found.scouted:
            chosen = [i for i, m in enumerate(base.effects) if m.name in wanted]
            self._scout([TriedSet([base.members[i] for i in chosen], [base.z[i] for i in chosen])])
        return self.finish(self.found.scouted[wanted])

    def part_without(self, base: EffectFit, name: str) -> EffectFit:
        """The part of a set that lacks one of its effects."""
        return self.subset(base, [n for n in base.names if n != name])
