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
from ldt_core.diagnosis.search import Fit

WORTH = 0.025  # of the gap in the speed that a further effect must explain, and
HALF = 0.5  # of what is left; or
LITTLE = 0.003  # of the gap, if that is also
NEARLY_ALL = 0.75  # of what is left
LAWS = 0.01  # of the gap, that a simpler set may leave in addition and still be the answer
KIN = 0.06  # of the gap, if the set has an effect of its family already


def kin(members: Sequence[Candidate]) -> int:
    """How many effects of a set share their family with another one before them."""
    families = [c.effect.family for c in members if c.effect.family]
    return len(families) - len(set(families))


def plain_enough(simpler: Fit, best: Fit, behind: float, gap: float) -> bool:
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
    return simpler.free < best.free and behind <= (KIN if mine == its else LAWS) * gap


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
    need = (WORTH * max(0, added - related) + KIN * related) * gap
    if gain > need and gain > HALF * left:
        return True
    return related == 0 and gain > LITTLE * added * gap and gain > NEARLY_ALL * left
