"""The causes of a model: what acts, by how much, and what has become of it, in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ldt_core.base.sentences import listed, spoken
from ldt_core.effects.change_description import Intervals, apart, change_of, doubt_of
from ldt_core.physics.effect import Effect


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
        """Whether its amounts are other ones than before, beyond chance."""
        if not before.name(effect):
            return True
        was, now = before.interval(effect), self.interval(effect)
        return was.keys() != now.keys() or any(apart(was[n], now[n]) for n in now)

    def change(self, before: Causes, doubts: Mapping[str, str], strained: Mapping[str, str]) -> str:
        """What has changed; "" where nothing has, beyond chance.

        Args:
            before: as it was.
            doubts: names of effects that are not known to act, or to have gone, and why.
            strained: names of effects, and what parameter of the file would explain as much.
        """
        said, unknown = [], []
        for effect in self.effects:
            name = effect.name
            if not self.moved(before, effect):
                continue
            if doubt := doubts.get(name) or doubt_of(effect, self.interval(effect)):
                unknown.append(doubt)
            else:
                was = {**effect.neutral, **before.given.get(name, {})}
                said.append(change_of(effect, was, self.given[name], self.interval(effect)))
                others = list(map(spoken, self.alike if effect is self.effects[-1] else ()))
                others += [strained[name]] if name in strained else []
                if others:
                    said[-1] += f" (or {listed(others, 'or')}: not told apart)"
        taken = any(n in self.given for n in before.alike)  # for another one, not told apart
        for effect in before.effects[:-1] if taken else before.effects:
            name = effect.name
            if not before.name(effect) or name in (*self.given, *self.alike):
                continue
            if name in doubts:
                unknown.append(doubts[name])
            else:
                back = "is the file's again" if name in self.of_file else "has gone"
                said.append(f"{spoken(name)} {back}")
        if unknown:
            what = "what else has changed" if said else "what has changed"
            said.append(f"{what} is not known: {listed(unknown)}")
        return "; ".join(said)


def intervals_in(told: Mapping[str, Mapping[str, list[float] | None]]) -> dict[str, Intervals]:
    """The intervals of a model's record."""
    return {
        name: {
            n: (float(ends[0]), float(ends[1])) if ends else None for n, ends in of_effect.items()
        }
        for name, of_effect in told.items()
    }
