"""Sets of effects that a recording cannot tell from the best one, and what they have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ldt_core.base.sentences import listed, spoken
from ldt_core.diagnosis.effect_fit import EffectFit
from ldt_core.diagnosis.model_selection import FittedSets, kin, plain_enough
from ldt_core.diagnosis.thresholds import THRESHOLDS


def in_place_of_each(best: EffectFit, alike: Sequence[EffectFit]) -> list[list[str]]:
    """For each effect of a set, its name and those that the others have in its place."""
    groups = [[name] for name in best.names]
    family = {c.name: c.effect.family for f in alike for c in f.effects}
    for other in alike:
        new = [n for n in other.names if n not in best.names]
        gone = [g for g in groups if g[0] not in other.names]
        # Where several differ, one stands for that of its own family.
        for name in list(new):
            for group in gone:
                if family[name] and family[name] == family[group[0]]:
                    group += [name] if name not in group else []
                    new.remove(name)
                    gone.remove(group)
                    break
        for group in gone:
            group += [n for n in new if n not in group]
    return groups


def may_be_the_answer(found: FittedSets, pool: Sequence[EffectFit], gap: float) -> list[EffectFit]:
    """Of sets of one size those that may be the answer, the one that predicts best first."""
    alike = plainest(found, as_good_as_first(found, pool), pool, gap)
    # What leaves too much in the speed is no answer, however well it follows the current.
    alike = [f for f in alike if not no_cause(found, f, gap)] or alike
    alike = sorted(alike, key=lambda f: kin(f.effects))  # else the best first, as before
    # Of laws of one family the one that follows the machine best is what predicts it.
    clear = THRESHOLDS.indistinguishable_loss
    # One whose fit ran to its end is no answer where another is as good. Before something new, what
    # the machine is known to have may have changed.
    least = min(map(found.loss, alike)) + clear
    known = set(found.residuals.machine.acting)

    def order(f: EffectFit) -> tuple[bool, bool, int]:
        return bool(f.ended), found.loss(f) > least, -len(known.intersection(f.names))

    return sorted(alike, key=order)


def plainest(
    found: FittedSets, alike: Sequence[EffectFit], pool: Sequence[EffectFit], gap: float
) -> list[EffectFit]:
    """The sets that need the fewest parameters, the best first.

    A law with more parameters follows a machine better even where a simpler one is right. So where
    a simpler set leaves hardly more, it is the answer, and the other is named beside it if it does
    fit better.
    """
    best = alike[0]
    hopeless = no_cause(found, best, gap)
    close = [
        f
        for f in pool
        if plain_enough(f, best, found.behind(f, best), gap)
        and not _only_it_explains(found, best, f)
        and (hopeless or not no_cause(found, f, gap))
    ]
    if not close:
        alike = [f for f in alike if f is best or not _only_it_explains(found, best, f)]
        least = min(f.free for f in alike)
        return [f for f in alike if f.free == least]
    least = min(f.free for f in close)
    plain = [f for f in close if f.free == least]
    kept, limit = as_good_as_first(found, plain), THRESHOLDS.indistinguishable_loss
    related = [f for f in alike if f not in kept and found.loss(plain[0]) - found.loss(f) > limit]
    return [*kept, *related[:1]]


def as_good_as_first(found: FittedSets, pool: Sequence[EffectFit]) -> list[EffectFit]:
    """Sets that cannot be told from the first, by all channels and by the speed alone.

    Nor what differs in laws of the same families by less than any law is off the machine's.
    """
    best, band, limits = pool[0], found.band, THRESHOLDS
    least, share = limits.indistinguishable_loss, limits.indistinguishable_of_remainder
    of_all = max(least, share * band.excess(best.residual))
    of_speed = max(least, share * band.speed_excess(best.residual))
    off = limits.law_error**2
    related = (
        max(of_all, off * found.excess),
        max(of_speed, off * band.speed_gap(found.base, best.residual)),
    )

    def close(f: EffectFit) -> bool:
        reach, speed_reach = related if f.families == best.families else (of_all, of_speed)
        return found.loss(f) - found.loss(best) <= reach and found.behind(f, best) <= speed_reach

    return [f for f in pool if close(f)]


def divided(found: FittedSets, best: EffectFit) -> list[EffectFit]:
    """Sets of one effect more that need no more parameters and are as good, the plainest first."""
    larger = [f for f in found.standing(len(best.names) + 1) if f.free <= best.free]
    return sorted(as_good_as_first(found, [best, *larger])[1:], key=lambda f: f.free)


def as_fewer(found: FittedSets, best: EffectFit) -> str:
    """The note on fewer effects that explain as much with more parameters; "" without."""
    fewer = [f for f in found.standing(len(best.names) - 1) if f.free > best.free]
    names = [f.names for f in as_good_as_first(found, [best, *fewer])[1:2]]
    told = "".join(listed(map(spoken, n)) for n in names)
    return f"{told} explains as much, with more parameters" if told else ""


def _only_it_explains(found: FittedSets, best: EffectFit, simpler: EffectFit) -> bool:
    """Whether a law explains the machine to the noise, and a simpler one plainly does not.

    One that only mends the errors of a simpler law leaves some of them.
    """
    limit = found.band.speed_limit(THRESHOLDS.remainder_false_alarm)
    if found.left(best) > limit:
        return False
    plainly = THRESHOLDS.plainly_structured * limit
    return found.left(simpler) > plainly


def no_cause(found: FittedSets, fitted: EffectFit, gap: float) -> bool:
    """Whether a set leaves so much, beyond what its laws may depart, that it is no cause.

    As much as would earn a further effect its name: there is one without. Where the file's own
    numbers can follow the speed, and not the current, both together judge.
    """
    band = found.band
    left = band.excess(fitted.residual) - found.departures.taken(fitted) - found.own_laws
    if left <= THRESHOLDS.further_effect_of_gap * found.excess:
        return False
    return bool(unexplained(found, found.left(fitted), gap))


def unexplained(found: FittedSets, left: Any, gap: Any) -> Any:
    """Whether so much of the gap is left, in one draw or in each of many, that it is no cause.

    More than noise alone, and a stated part of the gap: two questions. What noise may be is not
    taken off what is left, which is free of noise on average; what the machine file's own laws may
    be off by is.
    """
    limit, left = found.band.speed_limit(THRESHOLDS.remainder_false_alarm), left - found.own_laws
    return (left > limit) & (left > THRESHOLDS.further_effect_of_gap * gap)
