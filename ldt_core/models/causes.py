"""The causes of a model: what acts, by how much, and what has become of it, in words."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple

from ldt_core.base.metrics import NOT_ACTED
from ldt_core.base.sentences import listed, spoken
from ldt_core.effects.change_description import Intervals, amounts_of, apart, change_of, doubt_of
from ldt_core.physics.effect import Effect


class Doubts(NamedTuple):
    """What is not known of a change.

    Attributes:
        unknown: names of effects that are not known to act, or to have gone, and why.
        strained: names of effects, and what in their place would explain as much.
        stays: names of effects that may well act as before.
        moves: names of effects that do not, though each of their amounts alone may be as before.
        own: what of the machine's own parameters would explain the change; "" for nothing.
    """

    unknown: Mapping[str, str] = MappingProxyType({})
    strained: Mapping[str, Sequence[str]] = MappingProxyType({})
    stays: Collection[str] = ()
    moves: Collection[str] = ()
    own: str = ""


#: Where there are none.
SURE = Doubts()


@dataclass(frozen=True, eq=False)
class Causes:
    """Effects that act.

    Attributes:
        effects: each with its values in `given` and their 95 % intervals in `intervals`, by name.
        alike: names of effects that explain the same in the place of the last one.
        of_file: names of those that the machine file knows.
    """

    effects: tuple[Effect, ...] = ()
    given: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    intervals: Mapping[str, Intervals] = field(default_factory=dict)
    alike: tuple[str, ...] = ()
    of_file: tuple[str, ...] = ()

    def name(self, effect: Effect) -> bool:
        """Whether it acts by an amount that is known well enough to be told."""
        return effect.name in self.given and not doubt_of(effect, self.interval(effect))

    def interval(self, effect: Effect) -> Intervals:
        """Of each of its parameters; none where nothing is known of it."""
        return self.intervals.get(effect.name, {})

    def moved(self, before: Causes, effect: Effect) -> bool:
        """Whether its amounts are other ones than before, beyond chance; a law that is told in more
        detail, or less, is the same.
        """
        if not before.name(effect):
            return True
        was, now = before.interval(effect), self.interval(effect)
        return any(apart(was[n], now[n]) for n in was.keys() & now.keys())

    def change(self, before: Causes, doubts: Doubts = SURE, lasting: bool = False) -> str:
        """What has changed; "" where nothing has, beyond chance.

        Args:
            before: as it was.
            doubts: what is not known.
            lasting: the machine has not changed; these are what acted before, too.
        """
        said, unknown = [], []
        for effect in self.effects:
            name = effect.name
            moved = name in doubts.moves or self.moved(before, effect)
            if name in doubts.stays or not moved:
                continue
            if doubt := doubts.unknown.get(name) or doubt_of(effect, self.interval(effect)):
                unknown.append(doubt)
            else:
                said.append(self._told(effect, before, lasting))
                others = list(map(spoken, self.alike if effect is self.effects[-1] else ()))
                others += doubts.strained.get(name, ())
                if others:
                    amounts = ", and then with other amounts" if len(said) > 1 else ""
                    said[-1] += f" (or {listed(others, 'or')}: not told apart{amounts})"
        taken = any(n in self.given for n in before.alike)  # for another one, not told apart
        for effect in before.effects:
            name = effect.name
            if not before.name(effect) or name in (*self.given, *self.alike, *doubts.stays):
                continue
            told_apart = taken and effect is before.effects[-1]
            if told_apart and not lasting:
                continue
            if name in doubts.unknown and not told_apart:
                unknown.append(doubts.unknown[name])
            elif lasting:
                said.append(f"{spoken(name)}{NOT_ACTED}")
            else:
                back = "is the file's again" if name in self.of_file else "has gone"
                said.append(f"{spoken(name)} {back}")
        if doubts.own and not said and not unknown:
            unknown.append(doubts.own)
        if unknown:
            what = f"what{' else' if said else ''} {'acts' if lasting else 'has changed'}"
            said.append(f"{what} is not known: {listed(unknown)}")
        return "; ".join(said)

    def _told(self, effect: Effect, before: Causes, lasting: bool) -> str:
        now, known = self.given[effect.name], self.interval(effect)
        if lasting:
            return f"{spoken(effect.name)} is {amounts_of(effect, now, known)}"
        was = {**effect.neutral, **before.given.get(effect.name, {})}
        return change_of(effect, was, now, known)


def intervals_in(told: Mapping[str, Mapping[str, list[float] | None]]) -> dict[str, Intervals]:
    """The intervals of a model's record."""
    return {
        name: {
            n: (float(ends[0]), float(ends[1])) if ends else None for n, ends in of_effect.items()
        }
        for name, of_effect in told.items()
    }
