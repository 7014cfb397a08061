"""What a search over sets of effects begins with: a few experiments, and what they tell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ldt_core.diagnosis.effect_fit import EffectFit
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.model_selection import Names
from ldt_core.diagnosis.nominal_prior import NominalPrior

SCOUT_SAMPLES = 6_000  # in the scout's experiments together, at most: bounds the time of a fit
SCOUT_EXPERIMENTS = 8  # at most: enough to show every part of a recording


def of_each_kind(fits: Sequence[EffectFit]) -> list[EffectFit]:
    """The first of those sets that consist of effects of the same families."""
    first: dict[Names, EffectFit] = {}
    for f in fits:
        first.setdefault(frozenset(c.effect.family or c.name for c in f.effects), f)
    return list(first.values())


def told(residuals: FreeRunResiduals, prior: NominalPrior, size: int) -> list[int]:
    """Coordinates of a prior of which a recording of so many residuals tells more than the prior.

    The others would only be moved by what the laws leave, at the price of a simulation each.
    """
    whole, base = prior.candidate(), residuals.of()
    found = []
    for j, unit in enumerate(np.eye(len(whole))):
        moved = residuals.of([(whole.effect, whole.given(unit))]) - base
        if float(moved @ moved) * size / residuals.size > 1.0:
            found.append(j)
    return found


def empty(residuals: FreeRunResiduals) -> EffectFit:
    """The set of no effects."""
    rest = residuals.of()
    return EffectFit((), (), rest, np.zeros((rest.size, 0)), float(rest @ rest))


def scouted(residuals: FreeRunResiduals) -> list[int]:
    """Places of the experiments that the scout works on, spread evenly over the recording."""
    sizes = [p.rows.stop - p.rows.start for p in residuals.pieces]
    count = max(1, min(SCOUT_EXPERIMENTS, int(SCOUT_SAMPLES // max(np.mean(sizes), 1))))
    count = min(count, len(sizes))
    return sorted({round(i) for i in np.linspace(0, len(sizes) - 1, count)})
