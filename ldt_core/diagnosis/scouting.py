"""What a search over sets of effects begins with: a few experiments, and what they tell."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.diagnosis.effect_fit import EffectFit, used
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.nominal_prior import NominalPrior
from ldt_core.diagnosis.simulated_experiments import Used

# In the scout's experiments together, about: bounds the time of a fit. With half as many again, of
# 92 sealed cases three had another member in a group, and none another outcome.
SCOUT_SAMPLES = 4_000
SCOUT_EXPERIMENTS = 8  # at most: enough to show every part of a recording
# Samples of an experiment that the scout takes whole. With half and with twice as many, six
# recordings of 33,000 samples (heating of 100 s, limits, a ripple, a delay beside a friction) have
# the same answers, in half and in twice the time.
LONGEST_SCOUTED = 16_000
SCOUT_STRETCHES = 4  # of so many samples together, where experiments are longer
WILD = 10.0  # times the loss without effects: a fit that begins with more may never find back
WEAKENINGS = 6  # halvings of a wild set's effects, down to a 64th


class Stretch(NamedTuple):
    """Samples from `begin` up to `stop` of the experiment at a place in the list."""

    place: int
    begin: int
    stop: int


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


def scouted(residuals: FreeRunResiduals, rest: Array) -> list[Stretch]:
    """What the scout works on: experiments from the largest gap to the smallest.

    An effect may act in one experiment only, such as a limit that only one of them reaches. Those
    that are too long are taken as stretches.

    Args:
        rest: (size,) what is to be explained.
    """
    found = [s for i, e in enumerate(residuals.experiments) for s in _stretches(i, len(e))]
    size = np.mean([s.stop - s.begin for s in found])
    few = len(found) == len(residuals.experiments)
    count = min(SCOUT_EXPERIMENTS, math.ceil(SCOUT_SAMPLES / size)) if few else SCOUT_STRETCHES
    parts = [np.concatenate([rest[rows] for rows in _rows(residuals, s)]) for s in found]
    order = np.argsort([-np.mean(part**2) for part in parts], kind="stable")
    chosen = np.linspace(0, len(found) - 1, min(count, len(found)))
    return [found[k] for k in sorted({int(order[round(i)]) for i in chosen})]


def _stretches(place: int, length: int) -> list[Stretch]:
    if length <= LONGEST_SCOUTED:
        return [Stretch(place, 0, length)]
    each = LONGEST_SCOUTED // SCOUT_STRETCHES
    return [Stretch(place, k, k + each) for k in range(0, length - each + 1, each)]


def _rows(residuals: FreeRunResiduals, s: Stretch) -> list[slice]:
    channels = residuals.pieces[s.place].channels
    return [slice(rows.start + s.begin, rows.start + s.stop) for rows in channels]


def looked_at(residuals: FreeRunResiduals, stretches: Sequence[Stretch]) -> NDArray[np.bool_]:
    """(size,) which residuals are of these stretches."""
    found = np.zeros(residuals.size, dtype=np.bool_)
    for rows in (rows for s in stretches for rows in _rows(residuals, s)):
        found[rows] = True
    return found


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
