"""Sets with another law in the place of a member: a plainer, a fuller, or one that looks alike."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.effect_fit import EffectFit
from ldt_core.diagnosis.set_fits import SetFits, TriedSet
from ldt_core.diagnosis.simulated_experiments import StartStates

FULLER = 3  # starts from which a law of more parameters is fitted
AS_STRONG = (0.6, 0.8, 1.0, 1.3, 1.7)  # of a start: what lies between it and the next


class RelatedSets(SetFits):
    """Fits of sets, and what may stand in a member's place; arguments as of `SetFits`."""

    def _in_place(self, base: EffectFit, of: Mapping[str, Collection[str]]) -> list[TriedSet]:
        """Sets with another effect in the place of a member, by the member's name."""
        tries = []
        for leave, member in enumerate(base.effects):
            names = set(of.get(member.name, ())) - set(base.names)
            rest = self._without(base, leave) if names else base
            ranked = self.responses.promised_beside(rest) if names else ()
            tries += [self._with(rest, c, z) for c, z, _ in ranked if c.name in names]
            # A law of the same parameters, or of fewer, begins where the member's fit has ended.
            given = member.given(base.z[leave])
            for c in self.candidates:
                if c.name in names and given.keys() >= c.effect.neutral.keys():
                    tries.append(self._with(rest, c, c.coordinates(given)))
        return tries

    def _relatives(self, member: Candidate) -> list[Candidate]:
        """Candidates of a member's family, itself among them; none of one that has no family."""
        family = member.effect.family
        return [c for c in self.candidates if family and c.effect.family == family]

    def _replaced(
        self,
        base: EffectFit,
        place: int,
        instead: Candidate,
        begun: Sequence[Array],
        count: int,
        starts: StartStates | None = None,
    ) -> list[TriedSet]:
        """Sets with another law in a place, all else as it is, from the starts that leave least.

        Args:
            begun: coordinates of that law.
            count: of the sets.
            starts: with which those coordinates are compared.
        """
        rest = [*base.use[:place], *base.use[place + 1 :]]
        uses = [[(instead.effect, instead.given(z)), *rest] for z in begun]
        left = [float(r @ r) for r in self.scout.of_all(uses, starts=starts)]
        tries = []
        for k in np.argsort(left, kind="stable")[:count]:
            members, z = list(base.effects), list(base.z[: len(base.effects)])
            members[place], z[place] = instead, begun[k]
            tries.append(TriedSet(members, z, base.starts))
        return tries

    def _with_fuller_laws(self, base: EffectFit) -> list[TriedSet]:
        """Sets with a relative of more parameters in the place of a member, begun where that ended.

        A gear with play has many minima; near the elastic coupling that it nearly is, one of them.
        """
        tries: list[TriedSet] = []
        for i, member in enumerate(base.effects):
            given = member.given(base.z[i])
            fuller = [c for c in self._relatives(member) if len(c) > len(member)]
            others = []
            for c in (c for c in fuller if c.name not in base.names):
                if not given.keys() < c.effect.neutral.keys():
                    others.append(c)
                    continue
                begun = [c.coordinates({**c.given(z), **given}) for z in c.starts()]
                begun = list({z.tobytes(): z for z in begun}.values())
                tries += self._replaced(base, i, c, begun, FULLER, base.starts)
            for c, begun in self._as_strong(others, base, i):
                tries += self._replaced(base, i, c, begun, FULLER, base.starts)
        return tries

    def _as_strong(
        self, instead: Sequence[Candidate], base: EffectFit, place: int
    ) -> Iterator[tuple[Candidate, list[Array]]]:
        """Other laws, each with coordinates by which it does about what a member does."""
        if not instead:
            return
        whole, without = self.scout.of_all([base.use, [*base.use[:place], *base.use[place + 1 :]]])
        for c in instead:
            start = self.responses.likest(c, np.subtract(without, whole))
            yield c, [c.scaled(start, k) for k in AS_STRONG]

    def _with_plainer_laws(self, base: EffectFit) -> list[EffectFit]:
        """Sets with relatives of fewer parameters in the place of one member, or of several."""
        found = {frozenset(base.names): base}
        for fitted in (asked := [base]):
            fewer = {
                m.name: [c.name for c in self._relatives(m) if len(c) < len(m)]
                for m in fitted.effects
            }
            new = self._scout(self._in_place(fitted, fewer))
            asked += [f for f in new if frozenset(f.names) not in found]
            found |= {frozenset(f.names): f for f in new}
        return list(found.values())[1:]

    def _with_twins(self, base: EffectFit) -> list[TriedSet]:
        """Sets with a twin in the place of a member, all else as it is: as strong as the member."""
        tries: list[TriedSet] = []
        known = {c.name: c for c in self.candidates}
        for i, member in enumerate(base.effects):
            names = sorted(self.twins.get(member.name, set()) - set(base.names))
            for twin, begun in self._as_strong([known[n] for n in names], base, i):
                tries += self._replaced(base, i, twin, begun, 1)
        return tries
