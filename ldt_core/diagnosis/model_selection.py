"""What a further effect must explain to be named.

No law is exactly the machine's, so that something is always left, and further effects can always
take away some of it. One is named if it explains a stated part of the gap; also a smaller part, if
that is nearly all that was left, which the shape of a law that is only a little off hardly ever is.
The exception are effects of the same family as one that is named already: they are what such a
shape looks like.
"""

from __future__ import annotations

from collections.abc import Sequence

from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.effect_fit import EffectFit
from ldt_core.diagnosis.thresholds import THRESHOLDS


def kin(members: Sequence[Candidate]) -> int:
    """How many effects of a set share their family with another one before them."""
    families = [c.effect.family for c in members if c.effect.family]
    return len(families) - len(set(families))


def plain_enough(simpler: EffectFit, best: EffectFit, behind: float, gap: float) -> bool:
    """Whether a set with fewer parameters leaves so little more that it may be the answer.

    Sets that differ only in the laws of their families are told apart by no less than a second
    effect of such a family must explain.

    Args:
        simpler: the one.
        best: the other.
        behind: power that the one leaves in addition.
        gap: power of the whole gap.
    """
    mine, its = (sorted(c.effect.family or c.name for c in f.effects) for f in (simpler, best))
    limits = THRESHOLDS
    share = limits.same_family_of_gap if mine == its else limits.simpler_set_of_gap
    return simpler.free < best.free and behind <= share * gap


def earned(
    smaller: Sequence[Candidate],
    larger: Sequence[Candidate],
    gain: float,
    left: float,
    gap: float,
) -> bool:
    """Whether a larger set is to be named instead of a smaller one.

    Args:
        smaller: effects of the one.
        larger: effects of the other.
        gain: power that only the larger one explains.
        left: power that the smaller one leaves beyond noise.
        gap: power of the whole gap.
    """
    added = len(larger) - len(smaller)
    related = max(0, kin(larger) - kin(smaller))
    limits = THRESHOLDS
    further = limits.further_effect_of_gap * max(0, added - related)
    need = (further + limits.same_family_of_gap * related) * gap
    if gain > need and gain > limits.further_effect_of_remainder * left:
        return True
    small = gain > limits.small_effect_of_gap * added * gap
    return related == 0 and small and gain > limits.small_effect_of_remainder * left
