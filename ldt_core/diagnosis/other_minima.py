"""Where a set's loss has several minima: the same effects, with other amounts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.sentences import listed, spoken
from ldt_core.diagnosis.attribution import deviations
from ldt_core.diagnosis.diagnosis import ParameterAmount
from ldt_core.diagnosis.effect_fit import EffectFit, fit
from ldt_core.diagnosis.effect_set_search import EffectSetSearch
from ldt_core.diagnosis.scouting import bearable
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.estimation.amount_interval import DEVIATIONS


def other_minima(
    search: EffectSetSearch, best: EffectFit, left: float, gap: float
) -> list[EffectFit]:
    """The same effects with other amounts that explain as much, fitted on all experiments.

    A slow sensor on a light motor answers as a fast one on a heavy motor does. Arguments as of
    `covariance`.
    """
    names, limits, residuals = frozenset(best.names), THRESHOLDS, search.residuals
    power = max(search.found.band.excess(best.residual), 0.0)
    behind = max(limits.indistinguishable_loss, limits.indistinguishable_of_remainder * power)
    spread, found = deviations(best, left, gap), [best]
    for end in sorted(search.ends.get(names, ()), key=lambda f: f.loss):
        close = not search.spent and search.near(end, search.found.scouted[names])
        if not close or not all(_apart(end, f, spread) for f in found):
            continue
        begun = bearable(residuals, end, search.found.base)
        other = fit(residuals, end.members, begun, own=end.own)
        if other.loss - best.loss <= behind and all(_apart(other, f, spread) for f in found):
            found.append(other)
    return found[1:]


def _apart(one: EffectFit, other: EffectFit, spread: Sequence[Array]) -> bool:
    """Whether an amount of the effects differs by more than a 95 % interval's half."""
    found = False
    for c, a, b, wide in zip(one.effects, one.z, other.z, spread, strict=False):
        told = [not p.cyclic for p in c.parameters]
        if len(a) != len(b):
            return False  # one of them in detail
        found |= bool(np.any(np.abs(a - b)[told] > DEVIATIONS * wide[told]))
    return found


def as_well(best: EffectFit | None, alike: Sequence[EffectFit]) -> str:
    """The note that tells of other amounts; "" if there are none."""
    told = []
    for other in _others(best, alike)[:1]:
        for c, (_, given) in zip(other.effects, other.use, strict=False):
            parts = [f"{p.name} near {given[p.name]:.2g} {p.unit}".rstrip() for p in c.parameters]
            told.append(f"{spoken(c.name)} ({', '.join(parts)})")
    return f"other amounts explain as much: {listed(told)}" if told else ""


def _others(best: EffectFit | None, alike: Sequence[EffectFit]) -> list[EffectFit]:
    return [f for f in alike if best and f is not best and f.names == best.names]


def undetermined(
    found: Mapping[str, Mapping[str, ParameterAmount]],
    best: EffectFit | None,
    alike: Sequence[EffectFit],
) -> dict[str, Mapping[str, ParameterAmount]]:
    """Amounts, without an interval where others, outside it, explain as much.

    Args:
        found: effect to parameter to amount.
        best, alike: the set in force, and those that are as good.
    """
    told = dict(found)
    for other in _others(best, alike):
        for effect, given in other.use[: len(other.effects)]:
            told[effect.name] = {
                name: replace(a, ci95=None)
                if a.ci95 and not a.ci95[0] <= given[name] <= a.ci95[1]
                else a
                for name, a in told[effect.name].items()
            }
    return told
