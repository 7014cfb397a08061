"""The sets of effects that explain a recording best, one, two and three at a time.

Every effect alone, then the pairs and triples that the responses promise; `SetFits` fits them, and
`RelatedSets` has what may stand in a member's place.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.diagnosis.candidate import START_SHAPES, Candidate
from ldt_core.diagnosis.effect_fit import EffectFit
from ldt_core.diagnosis.model_selection import FittedSets
from ldt_core.diagnosis.related_sets import RelatedSets
from ldt_core.diagnosis.responses import Responses, best_alone, rank_pairs, simulate_all
from ldt_core.diagnosis.ripple_orders import begun_at
from ldt_core.diagnosis.scouting import looked_at, of_each_kind
from ldt_core.diagnosis.set_fits import COMPARED, FAR_OFF, HIDDEN, TriedSet
from ldt_core.diagnosis.thresholds import THRESHOLDS

# Which sets are tried, to save time.
PAIRS = 5  # pairs fitted, those whose responses promise most
BASES = 3  # sets of one size that larger ones are built upon
ADDED = 3  # effects added to each of them whatever they promise, and as many that come close
ADDED_CLOSE = 0.5  # of the best promise: what an effect of the second half of those reaches
EXCHANGES = 2  # rounds in which the members of the best set are exchanged
ENABLED_STARTS = 200  # simulations of a pair of which one effect shows only beside the other
STARTS_BESIDE = 4  # of an effect that is simulated beside a set
RIVALS = 6  # effects that may take the place of a member of the chosen set
FINISHED_RIVALS = 6  # sets that differ from the chosen one in one member
RIVAL_CLOSE = 0.7  # of the best promise: what a rival reaches
SIZE_TRIED_ANYWAY = 3  # effects: sets up to this size are tried even where the last did not help
PROMISED = 0.5  # of what a further effect must explain: to first order, a promise may be half
WORTH_A_FIT = 0.1  # of the power left: what the response of such an addition promises


class EffectSetSearch(RelatedSets):
    """The search on one residuals; arguments as of `SetFits`."""

    def run(self) -> FittedSets:
        """Fit sets; once more by what is left, where that lies in experiments not looked at.

        An effect that acts in few experiments only may hide beside a larger one.
        """
        left, best = self._grow().least_left()
        if self.spent or not self._hidden(best):
            return self.found
        before, level = dict(vars(self)), self.found.band.level
        self._look(best.residual)
        self.found.band.level = self.band.level = level
        if left <= self._grow().least_left()[0]:
            vars(self).update(before)
        return self.found

    def _hidden(self, best: EffectFit) -> bool:
        """Whether a set leaves much in an experiment, and far less in all those looked at."""
        band, seen = self.found.band, looked_at(self.residuals, self.looked)
        left, gap = (band.speed_excess(r) for r in (best.residual, self.found.base))
        if left <= THRESHOLDS.further_effect_of_gap * gap:
            return False

        def largest(rows: NDArray[np.bool_]) -> float:
            parts = (best.residual[p.rows][rows[p.rows]] for p in self.residuals.pieces)
            return max((float(np.mean(part**2)) for part in parts if part.size), default=0.0)

        return largest(~seen) > HIDDEN * largest(seen)

    def _grow(self) -> FittedSets:
        """Fit sets of one effect, then larger ones as long as more is left than noise.

        With little left, or where two sizes gained nothing, the responses have to promise that a
        further effect explains it. A promise that was not kept is not believed again.
        """
        self._alone()
        bases, promised = BASES, False
        for count in range(1, THRESHOLDS.largest_set + 1):
            if count > 1:
                stuck = count > 2 and not self._gained(count - 1)
                if stuck and promised:
                    break
                before = self._best(count - 1)[0]
                promised = not self._room_for_more(before)
                asked = promised or (stuck and count > SIZE_TRIED_ANYWAY)
                if asked and not self._promised(before):
                    break
                bases = 1 if stuck else bases
                if count == 2:
                    self._pairs()
                self._build_on(count - 1, 1 if promised else bases)
                if not self._best(count):  # no candidate is left that shows
                    break
                before = self._best(count - 1)[0]
                self._exchange(count)
                now = self._best(count - 1)[0]
                # Out of a poor minimum, other effects may be missing beside it.
                if before.loss - now.loss > THRESHOLDS.further_effect_of_remainder * before.loss:
                    self._build_on(count - 1, 1)
                    self._exchange(count)
            self._settle(count)
            self._detail(count)
            best = self._best(count)
            if self.spent or not best or self._noise_alone(best[0]):
                break
        for size in range(1, count + 1):
            self._finish(size)
        largest = (self._best(count) or self._best(count - 1))[0]
        if not self._room_for_more(largest):
            self._divide(largest)
        return self.found

    def _divide(self, best: EffectFit) -> None:
        """Fit sets of one effect more that need no more parameters than the best set.

        The three of a soft coupling imitate an inertia and a friction, which have one each.
        """
        count, tries = len(best.effects), []
        for base in [f for f in self._best(count) if f.free < best.free][:BASES]:
            room = best.free - base.free
            ranked = self.responses.promised_beside(base)
            fit_in = [(c, z) for c, z, _ in ranked if len(c) - c.details <= room]
            tries += [self._with(base, c, z) for c, z in fit_in[:ADDED]]
        for f in self._scout(() if self.spent else tries):
            if f.loss < best.loss + THRESHOLDS.chance_gain:
                self.finish(f)

    def _noise_alone(self, best: EffectFit) -> bool:
        """Whether a set leaves noise alone, measured anew on it: the gap made it look rougher."""
        if not self.leaves_noise(best):
            return False
        self.band.level = self.band.channel_noise(best.residual)
        return self.leaves_noise(best)

    def _detail(self, count: int) -> None:
        """Take the laws of a family in detail where that is most of what the best set lacks.

        Such as friction that builds up over a turn: all dry friction of a machine does, or none.
        """
        found = self._best(count)
        if self.spent or not found or self.leaves_noise(found[0]):
            return
        best, before = found[0], self.in_detail
        families = {c.effect.family for c in best.effects if c.detailed is not None}
        laws = {
            c.name: detailed
            for c in self.candidates
            if c.effect.family in families and (detailed := c.detailed) is not None
        }
        if not laws:
            return
        whole = TriedSet(best.effects, best.z[:count], best.starts)
        for shape in START_SHAPES:
            self.in_detail = {**before, **{n: c.details_at(shape) for n, c in laws.items()}}
            self._scout([whole])
        now = self.found.scouted[frozenset(best.names)]
        least = THRESHOLDS.further_effect_of_remainder * self.band.excess(best.residual)
        if now.ended or best.loss - now.loss < max(least, THRESHOLDS.chance_gain):
            self.in_detail, self.found.scouted[frozenset(best.names)] = before, best
            return
        # The other laws of the family begin with what this one has found.
        at = {
            (c.effect.family, c.details): z[len(z) - c.details :]
            for c, z in zip(now.effects, now.z, strict=False)
            if c.name in laws
        }
        for name, c in laws.items():
            self.in_detail[name] = at.get((c.effect.family, c.details), self.in_detail[name])
        plainly = [f for n, f in self.found.scouted.items() if n & laws.keys() and f is not now]
        for f in plainly:
            del self.found.scouted[frozenset(f.names)]
        for size in range(1, count + 1):
            again = sorted((f for f in plainly if len(f.names) == size), key=lambda f: f.loss)
            self._scout(
                [TriedSet(f.effects, f.z[:size], f.starts) for f in again[:COMPARED]], whatever=True
            )

    def _room_for_more(self, best: EffectFit) -> bool:
        """Whether a set leaves so much that a further effect could be named by its own part."""
        left, gap = self.band.excess(best.residual), self.band.excess(self.responses.base)
        return left > THRESHOLDS.further_effect_of_gap * gap

    def _promised(self, best: EffectFit) -> bool:
        """Whether a further effect promises part of what a set leaves, if that is little.

        Or whether two promise nearly all of it, which may stand in the place of a member.
        """
        count = len(best.effects)
        self._scout([TriedSet(best.effects, best.z[:count], best.starts)])  # to its very end
        best = self._best(count)[0]
        one, two = self._about(best).explained_beside(best)
        left, half = self.band.excess(best.residual), THRESHOLDS.further_effect_of_remainder
        much = one > PROMISED * half * left or two > THRESHOLDS.nearly_all_of_remainder * left
        return much and not self.leaves_noise(best)

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
        self._scout(tries, whatever=True)

    def _pairs(self) -> None:
        ranked = sorted(rank_pairs(self.responses).items(), key=lambda q: -q[1][0])
        z, c = self.responses.z, self.candidates
        tries = [TriedSet([c[i], c[j]], [z[k], z[m]]) for (i, j), (_, k, m) in ranked[:PAIRS]]
        self._scout(() if self.spent else tries)
        self._scout(() if self.spent else self._enabled())

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
                if self.spent or float(np.sum((rest - base) ** 2)) < THRESHOLDS.visible_change:
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
                best = np.argsort([float(r @ r) for r in runs])[:ADDED]
                tries += [TriedSet([other, c], grid[k]) for k in best]
        return [] if self.spent else tries

    def _build_on(self, count: int, bases: int) -> None:
        tries = []
        kinds = of_each_kind(self._best(count), self.near)[: 0 if self.spent else bases]
        for k, base in enumerate(fitted for kind in kinds for fitted in kind):
            more = [*self.additions(base, ADDED), *self.additions(base, 2 * ADDED, ADDED_CLOSE)]
            if k == 0 or count == 1:
                more += self.additions(base, ADDED, about=self._about(base))
            chosen = {c.name: (c, z) for c, z in more}.values()
            tries += [self._with(base, candidate, start) for candidate, start in chosen]
        self._scout(() if self.spent else tries)

    def _exchange(self, count: int) -> None:
        """Try others in the place of each member of the best set, until that gains nothing.

        What promised most at first may have stood for something that is found only beside others.
        """
        for _ in range(EXCHANGES):
            best = self._best(count)[0]
            if self.leaves_noise(best):
                break
            tries = []
            for leave in range(count):
                rest = self._without(best, leave)
                for candidate, start in self.additions(rest, ADDED, about=self._about(rest)):
                    if frozenset([*rest.names, candidate.name]) not in self.found.scouted:
                        tries.append(self._with(rest, candidate, start))
            self._scout(() if self.spent else tries)
            if self.spent or self._best(count)[0] is best:
                break
        best = self._best(count)[0]
        if not (self.spent or self.leaves_noise(best)):
            self._scout(self._with_fuller_laws(best))
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

    def _about(self, base: EffectFit) -> Responses:
        """What the other effects do beside a set: some act only together with another one."""
        if base in self.beside:
            return self.beside[base]
        others = [c for c in self.candidates if c.name not in base.names]
        promising, ripples = self.responses.promising(base, STARTS_BESIDE), self.ripples(base)
        self.beside[base] = simulate_all(
            self.scout,
            others,
            lambda: self.tick("simulating effects"),
            base,
            self.workers,
            lambda c: [*promising(c), *begun_at(c, ripples)],
        )
        return self.beside[base]

    def additions(
        self, base: EffectFit, count: int, close: float = 0.0, about: Responses | None = None
    ) -> list[tuple[Candidate, Array]]:
        """Effects that promise most beside a set, with the values to begin with.

        Args:
            about: responses beside that set; None takes those of the machine file alone.
        """
        enough = max(self.band.excess(base.residual), 0.0)
        start = self.found.scouted[frozenset()].loss
        promise = WORTH_A_FIT * enough if enough > FAR_OFF * start else 0.0
        ranked = (about or self.responses).promised_beside(base)
        best = ranked[0][2] if ranked else 0.0
        enough_for = [(c, z) for c, z, gain in ranked if gain >= max(promise, close * best)]
        # Where each experiment may choose an angle, a ripple promises more than it can keep.
        turned = self.responses.with_free_phase
        kept = [(c, z) for c, z in enough_for if c.name not in turned][:count]
        return [(c, z) for c, z in enough_for[:count] if c.name in turned] + kept

    def _from_parts(self, base: EffectFit) -> None:
        """Fit a set once more from each of its parts, as that alone would have it.

        Where two effects may exchange what they do, this leads to the other minimum.
        """
        for leave, member in enumerate(base.effects if len(base.effects) > 1 else ()):
            rest = self._without(base, leave)
            ranked = self.responses.promised_beside(rest)
            self._scout([self._with(rest, c, z) for c, z, _ in ranked if c.name == member.name])

    def _exchanged(self, base: EffectFit) -> list[TriedSet]:
        """Sets that differ from a set in one member, the most promising."""
        tries = []
        for leave in range(len(base.effects)):
            rest = self._without(base, leave)
            more = [] if self.spent else self.additions(rest, RIVALS + 1, RIVAL_CLOSE)
            tries += [self._with(rest, c, z) for c, z in more if c.name not in base.names]
        return tries

    def exchange(self, base: EffectFit) -> None:
        """Fit on all experiments what differs in one member from a set as good as the best."""
        scouted = self.found.scouted
        new = [
            t for t in self._exchanged(base) if frozenset(c.name for c in t.members) not in scouted
        ]
        for f in self._scout(new):
            if self.near(f, scouted[frozenset(base.names)]):
                self.finish(f)

    def alternatives(self, base: EffectFit) -> list[EffectFit]:
        """Sets that differ from a set in one member, the most promising, fitted on all."""
        tries = self._exchanged(base)
        # A law of fewer parameters, and what no recording tells from a member, whatever it costs.
        plain, twins = self._with_plainer_laws(base), self._with_twins(base)
        tries += [*twins, *(t for b in plain for t in self._with_twins(b))]
        fitted, best, count = self.found.scouted, frozenset(base.names), len(base.effects)
        tried = {frozenset(f.names) for f in [*plain, *self._scout(tries)]}
        self._from_parts(base)
        # Whatever led to them: what promises little where the rest has gone astray may do as well.
        tried |= {n for n in fitted if len(n) == count == len(n & best) + 1}
        other = [f for n, f in fitted.items() if len(n) == count and n not in tried and n != best]
        scouted, found = fitted.get(best, base), [f for n, f in fitted.items() if n in tried]
        close = [f for f in found if self.near(f, scouted) or self._plainer(f, scouted)]
        # The plainest are the answer where they do, and more parameters always leave a little less.
        by_loss = sorted(close, key=lambda f: f.loss)
        plain = sorted((f for f in by_loss if f.free < base.free), key=lambda f: f.free)
        chosen = dict.fromkeys([*by_loss[:FINISHED_RIVALS], *plain[:FINISHED_RIVALS]])
        # Nor need they share a member: what the scout cannot tell from the set is its rival, too.
        apart = sorted((f for f in other if self.near(f, scouted)), key=lambda f: f.loss)
        done = [self.finish(f) for f in [*chosen, *apart[:FINISHED_RIVALS]]]
        for twin in twins:
            self.as_far_as(base, twin)
        return done
