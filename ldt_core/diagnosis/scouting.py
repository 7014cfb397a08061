"""What a search over sets of effects begins with: a few experiments, and what they tell."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.diagnosis.effect_fit import EffectFit, used
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.nominal_prior import NominalPrior
from ldt_core.diagnosis.simulated_experiments import Used

# In the scout's experiments together, about: bounds the time of a fit. With half as many again, of
# 92 sealed cases three had another member in a group, and none another outcome.
SCOUT_SAMPLES = 4_000
SCOUT_EXPERIMENTS = 8  # at most: enough to show every part of a recording
WILD = 10.0  # times the loss without effects: a fit that begins with more may never find back
WEAKENINGS = 6  # halvings of a wild set's effects, down to a 64th


def of_each_kind(
    fits: Sequence[EffectFit], near: Callable[[EffectFit, EffectFit], bool]
) -> list[list[EffectFit]]:
    """Of the sets whose effects are of the same families the first, and a plainer one near it.

    A law that can follow more may stand beside what is missing where a plainer one points to it.

    Args:
        fits: the best first.
        near: whether a set is near the best of its kind.
    """
    kinds: dict[tuple[str, ...], list[EffectFit]] = {}
    for f in fits:
        kind = kinds.setdefault(f.families, [])
        if not kind or (f.free < min(k.free for k in kind) and near(f, kind[0])):
            kind.append(f)
    return [[kind[0], *kind[1:][-1:]] for kind in kinds.values()]


def told(
    residuals: FreeRunResiduals,
    prior: NominalPrior,
    size: int,
    beside: Sequence[Used] = (),
    among: Sequence[int] | None = None,
) -> list[int]:
    """Coordinates of a prior of which a recording of so many residuals tells more than the prior.

    The others would only be moved by what the laws leave, at the price of a simulation each.

    Args:
        beside: effects that act: without unbalance, no speed tells of a foundation.
        among: coordinates to ask about; None takes all.
    """
    whole = prior.candidate()
    asked = range(len(whole)) if among is None else among
    if not asked:
        return []
    units = np.eye(len(whole))[list(asked)]
    base, *moved = residuals.of_all(
        [[*beside], *([*beside, (whole.effect, whole.given(u))] for u in units)]
    )
    enough = residuals.size / size
    return [j for j, m in zip(asked, moved, strict=True) if float(np.sum((m - base) ** 2)) > enough]


def empty(residuals: FreeRunResiduals) -> EffectFit:
    """The set of no effects."""
    rest = residuals.of()
    return EffectFit((), (), rest, np.zeros((rest.size, 0)), float(rest @ rest))


def scouted(residuals: FreeRunResiduals, rest: Array) -> list[int]:
    """Places of the experiments that the scout works on: from the largest gap to the smallest.

    An effect may act in one experiment only, such as a limit that only one of them reaches.

    Args:
        rest: (size,) what is to be explained.
    """
    sizes = [p.rows.stop - p.rows.start for p in residuals.pieces]
    count = min(SCOUT_EXPERIMENTS, math.ceil(SCOUT_SAMPLES / max(np.mean(sizes), 1)))
    order = np.argsort([-np.mean(rest[p.rows] ** 2) for p in residuals.pieces], kind="stable")
    chosen = np.linspace(0, len(sizes) - 1, min(count, len(sizes)))
    return sorted({int(order[round(i)]) for i in chosen})


def bearable(residuals: FreeRunResiduals, scouted: EffectFit, base: Array) -> list[Array]:
    """Coordinates of a scouted set, weaker where not all experiments bear such effects.

    What a few of them allow may run away in another one: a winding that melts there.

    Args:
        residuals: of all experiments.
        base: (size,) those without any effect.
    """
    begun = list(scouted.z)
    for _ in range(WEAKENINGS):
        left = residuals.of(used(scouted.members, begun))
        if float(left @ left) <= WILD * float(base @ base):
            break
        begun = [c.scaled(z, 0.5) for c, z in zip(scouted.members, begun, strict=True)]
    return begun
