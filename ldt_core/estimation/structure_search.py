"""Which effects to add to a machine so that it explains an experiment: a search over structures.

Every effect of a library is tried, beside those that are there and in their place, under the
observer of `grey_box`, which needs few steps; then a further one beside the best, and so on. What
comes with it is then tried beside the rivals of the one before, too (a beam search). The machine's
uncertain parameters are eliminated to first order meanwhile, under their prior: what they explain
as well is no evidence for an effect.
The best structures are then fitted whole, and ranked by the squared residuals plus the price of
their parameters (Bayesian information criterion: Schwarz, Annals of Statistics 6, 1978).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.pausable import Pausable
from ldt_core.base.threads import spread
from ldt_core.estimation.fitted_structure import SURPRISING, FittedStructure
from ldt_core.estimation.grey_box import GreyBox, Prior
from ldt_core.estimation.grey_box_fit import GreyBoxFit, fit_grey_box
from ldt_core.estimation.misfit import BY_CHANCE
from ldt_core.estimation.structure_screening import (
    STRONGEST,
    WEAKEST,
    Present,
    Screened,
    Screening,
)
from ldt_core.physics.base import CURRENT
from ldt_core.physics.effect import Effect

#: Screenings, in turn until one explains: observer gain, and whether parameters that an effect
#: brings to life are fitted with it. Where parameters are off, fitting finds what first order does
#: not; under the weak observer, whose squared error has more minima, it is the last resort.
SCREENINGS = ((STRONGEST, True), (WEAKEST, False), (WEAKEST, True))
#: Place of the one before which laws are tried in detail.
LAST_RESORT = 2
#: Structures of each screening that are fitted whole: the best and its rival; of a machine without
#: a foundation, whose fits are short, all that screen as well as the best but for so many squared
#: deviations (chi-square distribution, p = 0.001), at most.
FINALISTS, CLOSE, MOST_FINALISTS = 2, 10.8, 5
#: Structures that are screened between two pauses.
AT_ONCE = 4
#: Effects of a structure: of what few experiments tell, more are rarely told apart.
MOST_EFFECTS = 3
#: Part of the squared error that the best structure removes under the observer: one that leaves
#: more than this of it is not fitted whole.
SERIOUS = 0.5
#: Times the price of an effect's parameters, that it gains to first order where nobody asks what a
#: fit without it would leave.
SURELY = 100.0
#: Times what an effect gains by itself, that it is hoped to gain beside others. What acts side by
#: side does not gain more together than the sum, but to first order only.
HOPED = 2.0


def _told(box: GreyBox, fit: GreyBoxFit, near: Array | None) -> Array:
    """(n,) coordinates of a fit, those of effects where they are expected if that hardly costs.

    What an experiment does not tell, a fit may move anywhere: friction backward, where a shaft has
    turned forward. Less than one squared deviation of noise tells nothing. Where a value is known,
    nor does one that by chance might as well be none.
    """
    q, expected = fit.q.copy(), np.zeros(box.size) if near is None else near
    for j in box.sized:
        told, alone = (far**2 * fit.information[j, j] for far in (q[j] - expected[j], q[j]))
        if told < 1.0 or (near is not None and max(told, alone) < BY_CHANCE**2):
            q[j] = expected[j]
    return q


class StructureSearch(Screening):
    """The structures of one machine, screened and fitted; arguments as of `Screening`."""

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
        again: bool = True,
    ) -> Pausable[FittedStructure]:
        """These effects with the machine's parameters, fitted whole; see `fit_grey_box`.

        Args:
            again: as of `GreyBox.first_guesses`.
        """
        box = GreyBox(self.machine, effects, self.tolerances)
        guesses = box.first_guesses(present.given, again=again)
        starts = [np.concatenate([present.prior.mean, g]) for g in guesses]
        return (yield from self._structure(box, present.prior, starts, near, sized))

    def beside(self, present: Present, effect: Effect) -> Pausable[FittedStructure]:
        """One more effect, the present ones being begun with as they are."""
        effects = (*present.effects, effect)
        return (yield from self.fitted(present, effects, sized=False, again=False))

    def refined(self, present: Present, near: Array) -> Pausable[FittedStructure]:
        """The present effects with the machine's parameters, fitted next to these coordinates."""
        box = GreyBox(self.machine, present.effects, self.tolerances)
        return (yield from self._structure(box, present.prior, (), near, sized=False))

    def _structure(
        self, box: GreyBox, prior: Prior, starts: Sequence[Array], near: Array | None, sized: bool
    ) -> Pausable[FittedStructure]:
        fit = yield from fit_grey_box(self.problem(box, prior), starts, near=near, sized=sized)
        yield box.work.taken()
        fit = replace(fit, q=_told(box, fit, near))
        own = box.size - len(box.uncertain)
        return FittedStructure(box, fit, prior, fit.cost + own * math.log(self._samples))

    def search(
        self, present: Present, library: Sequence[Effect]
    ) -> Pausable[list[FittedStructure]]:
        """The best structures, fitted whole, the best first.

        Effects are added one by one under the observer, the values of the others being estimated
        along, until the innovations are noise or nothing is gained. The weaker observer is asked
        only where what the stronger one found does not explain the experiments; see `SCREENINGS`.
        It goes on from that where it left noise under the stronger one.

        Args:
            present: to which effects are added, or which they replace.
            library: of effects that this machine can have.
        """
        found: list[FittedStructure] = []
        screened: list[tuple[float, Present]] = []
        best = present
        for i, (gain, jointly) in enumerate(SCREENINGS):
            if i == LAST_RESORT and found:
                found += yield from self._in_detail(found, library)
                if found[-1].explains:
                    break
            begin = present if jointly else best
            silent = jointly and self.machine_slopes(begin, gain)[1].any()
            if (gain, begin) in screened and not silent:
                continue  # it would be the same again
            screened.append((gain, begin))
            led, grown = yield from self._grown(begin, library, gain, jointly, begin is present)
            best = grown[0] if led else present
            for place, new in enumerate(grown):
                explained = any(structure.explains for structure in found)
                if place >= FINALISTS and not explained:
                    break  # what explains nothing needs no more rivals
                if all(set(new.effects) != set(other.box.effects) for other in found):
                    # What an observer cannot lead to noise hardly explains: its size will do, and
                    # there is no need of a rival. Nor has one that explains nothing to be sized.
                    sized = led and not explained
                    found.append((yield from self.fitted(new, new.effects, sized=sized)))
                if not led and not found[-1].explains:
                    break
            if any(structure.explains for structure in found):
                break
        if not found:
            return []
        found = sorted(found, key=lambda s: s.score)
        found[0] = yield from self.pruned(found[0], present.given, found)
        if any(structure.explains for structure in found):
            found += yield from self._in_detail(found, library)
        return sorted(found, key=lambda s: s.score)

    def _in_detail(
        self, found: Sequence[FittedStructure], library: Sequence[Effect]
    ) -> Pausable[list[FittedStructure]]:
        """What explains with laws in all detail, where nothing does plainly, or with more
        parameters.

        The laws of the simplest plain structure, then of the best one, where they have such. Else
        one in place of an effect of the simplest: of each family the law of most detail, since a
        family's laws differ by less. In place of which, is told plainly: an observer hides the
        details, and a whole fit is long.
        """
        best = min(found, key=lambda s: s.score)
        simplest = min(found, key=lambda s: (len(s.names), s.score))
        own = [s for s in dict.fromkeys((simplest, best)) if any(e.detailed for e in s.box.effects)]
        tried = [(s, s.box.effects) for s in own]
        if not own:
            tried = [
                (simplest, (*(e for e in simplest.box.effects if e is not gone), law))
                for law in _most_detailed(library)
                for gone in simplest.box.effects
            ]
        if best.explains:  # there is no need of as many parameters
            less = best.box.size - len(best.box.uncertain)
            tried = [t for t in tried if sum(len(e.all_parameters) for e in t[1]) < less]
        if not tried:
            return []
        known = [plain.present.given for plain, _ in tried]
        if not own:
            begin = simplest.present
            basis, silent = self.machine_slopes(begin, WEAKEST)
            asked = basis, WEAKEST, np.zeros_like(silent)
            all_laws = [laws for _, laws in tried]
            screened = yield from self._screened_all([begin] * len(tried), all_laws, asked)
            least = min(range(len(tried)), key=lambda i: screened[i].cost)
            tried, known = [tried[least]], [screened[least].given]
        for (plain, laws), values in zip(tried, known, strict=True):
            finest = tuple(e.finest for e in laws)
            given = {e.name: {**e.neutral, **values[e.name]} for e in finest}
            begin = Present(finest, given, plain.prior)
            detailed = yield from self.fitted(begin, finest, sized=False)
            if detailed.explains:
                return [(yield from self.pruned(detailed))]
        return []

    def pruned(
        self,
        found: FittedStructure,
        before: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
        others: Sequence[FittedStructure] = (),
    ) -> Pausable[FittedStructure]:
        """What explains, without the effects that do not pay the price of their parameters.

        One that acted before stays where that is likelier than that it has gone, and all others
        are as they were: few experiments need not show all that acts.

        Args:
            found: which explains.
            before: effects that acted, with their values.
            others: that are fitted already.
        """
        known = {frozenset(s.box.effects): s for s in others}
        best = found
        while len(best.box.effects) > 1 and best.explains:
            given = best.present.given
            acted = {n: v for n, v in before.items() if n in best.names}
            fewer = []
            for gone in best.box.effects:
                if best.needs(gone, SURELY * len(gone.parameters) * math.log(self._samples)):
                    continue
                if gone.name in acted and best.keeps(gone, acted):
                    continue
                rest = tuple(e for e in best.box.effects if e is not gone)
                laws = frozenset(rest)
                if laws not in known:
                    here = Present(rest, given, best.prior)
                    known[laws] = yield from self.fitted(here, rest, sized=False)
                fewer.append(known[laws])
            # Under the noise that a model far off leaves, what explains nothing may score better.
            explaining = (s for s in fewer if s.explains)
            least = min(explaining, key=lambda s: s.score, default=best)
            if least is best or least.score > best.score:
                break
            best = least
        return best

    def _grown(
        self,
        present: Present,
        library: Sequence[Effect],
        gain: float,
        jointly: bool,
        replacing: bool,
    ) -> Pausable[tuple[bool, list[Present]]]:
        """The best structure under an observer of this gain, and the rival of its last effect.

        And whether the best leaves noise. A stronger observer than the weakest is not asked where
        it leaves noise without any effect: the cause is one that it hides.
        """
        found: list[Present] = []
        serious: list[Present] = []
        led = False
        while len(present.effects) < MOST_EFFECTS:
            here = {e.name for e in present.effects}
            tried = [(*present.effects, e) for e in library if e.name not in here]
            if replacing and not found:  # and other ones in the place of those that were there
                tried += [(e,) for e in library if here]
            basis, silent = self.machine_slopes(present, gain)
            silent &= jointly
            before = self.screened(present, present.effects, basis, gain, silent)
            if not found and before.explains and gain > WEAKEST:
                break

            asked = basis, gain, silent
            results = yield from self._screened_all([present] * len(tried), tried, asked)
            # What is the best alone need not be part of the best pair: its rivals are tried, too.
            last = tried[int(np.argmin([r.cost for r in results]))][-1]
            others = [p for p in serious[1:MOST_FINALISTS] if last not in p.effects]
            pairs = [(*p.effects, last) for p in others]
            results += yield from self._screened_all(others, pairs, asked)
            tried += pairs
            order = sorted(range(len(tried)), key=lambda i: results[i].cost)
            best = results[order[0]]
            if not best.cost < before.cost:
                break
            # What recovers less than half of what the best does is no rival of it.
            limit = best.cost + SERIOUS * (before.cost - best.cost)
            rigid = len(self.machine.model.states) == CURRENT + 1
            serious = [
                Present(tried[i], results[i].given, present.prior)
                for i in order
                if results[i].cost <= limit
            ]
            most = best.cost + CLOSE
            close = sum(r.cost <= most for r in results) if rigid else 0
            found = serious[: max(FINALISTS, min(MOST_FINALISTS, close))]
            led = best.explains
            if led or self._hopeless(present, before, [results[i] for i in order]):
                break
            present = found[0]
        return led, found

    def _screened_all(
        self,
        present: Sequence[Present],
        tried: Sequence[tuple[Effect, ...]],
        how: tuple[Array, float, NDArray[np.bool_]],
    ) -> Pausable[list[Screened]]:
        """Each of the structures tried, beginning with what is present beside it."""
        results: list[Screened] = []
        for begin in range(0, len(tried), AT_ONCE):
            pairs = list(zip(present, tried, strict=True))[begin : begin + AT_ONCE]
            screen = functools.partial(self._screen, pairs, how)
            results += spread(screen, len(pairs), self.workers)
            yield sum(screened.work for screened in results[begin:])
        return results

    def _screen(
        self,
        pairs: Sequence[tuple[Present, Sequence[Effect]]],
        how: tuple[Array, float, NDArray[np.bool_]],
        i: int,
    ) -> Screened:
        present, tried = pairs[i]
        return self.screened(present, tried, *how)

    def _hopeless(self, present: Present, before: Screened, ranked: Sequence[Screened]) -> bool:
        """Whether further effects cannot be hoped to gain what is missing.

        Beside a first one each is hoped to gain what that did: an unbalance that captures the shaft
        hides what else acts. Beside more, what it would have gained in the place of the last one.
        """
        left = MOST_EFFECTS - len(present.effects) - 1
        others = ranked[1 : 1 + left] if present.effects else [ranked[0]] * left
        gains = sum(before.cost - other.cost for other in others)
        return ranked[0].cost - HOPED * gains > self._most_noise


def _most_detailed(library: Sequence[Effect]) -> list[Effect]:
    """Of each family that has laws in detail the one of most; the plainer one of several."""
    found: dict[str, Effect] = {}
    for law in sorted(library, key=lambda e: len(e.parameters) - len(e.all_parameters)):
        if law.detailed is not None:
            found.setdefault(law.family, law)
    return list(found.values())
