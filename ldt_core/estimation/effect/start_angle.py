"""Whether a machine starts at the same angle every time, judged by the angles found so far.

Two hypotheses, equally likely beforehand: every experiment at rest starts at one and the same
unknown angle, or each at any angle. An angle that was found is worth its deviation; one in ten is
held to be wrong altogether, since a free run can fit for a wrong reason.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

WRONG_SHARE = 0.1  # of the angles found say nothing: a free run can fit for a wrong reason
GRID = 2000  # angles in a turn, over which the common one is summed: 0.2 degrees apart
LEAST_STD = 0.002  # rad, a tenth of a degree: what a machine that homes its shaft repeats
MOST_STD = 0.15  # of a turn: an angle known no better than that is left out
AGREEMENT = 4.0  # deviations from the common angle: those further off do not shape it
MOST_ANGLES = 50  # remembered: they bound what a model's record holds


@dataclass(frozen=True)
class FoundAngle:
    """The start angle found in the experiment of that number, and its deviation [rad]."""

    number: int
    angle: float
    std: float


@dataclass(frozen=True)
class AngleBelief:
    """What follows from the angles.

    The probability that it is the same angle every time, which one is then most likely [rad] (None
    while none was found), and its deviation [rad].
    """

    same: float
    angle: float | None
    std: float


def believe(seen: Sequence[FoundAngle], turn: float) -> AngleBelief:
    """Weigh the two hypotheses by the angles seen; one of `turn` > 0 [rad] makes no difference."""
    if not seen:
        return AngleBelief(0.5, None, turn / math.sqrt(12))
    angle = np.array([s.angle for s in seen])
    std = np.array([s.std for s in seen])
    # Centred on the best angle, so that one alone is reproduced without the grid's error.
    centre = angle[int(np.argmin(std))]
    grid = centre + turn * (np.arange(GRID) - GRID // 2) / GRID
    apart = grid[:, None] - angle
    apart -= turn * np.round(apart / turn)
    normal = np.exp(-((apart / std) ** 2) / 2) / (std * math.sqrt(2 * math.pi))
    density = np.log((1 - WRONG_SHARE) * normal + WRONG_SHARE / turn).sum(axis=1)
    top = float(density.max())
    weight = np.exp(density - top)
    evidence = top + math.log(float(weight.mean())) + len(seen) * math.log(turn)
    same = 1 / (1 + math.exp(-min(max(evidence, -700.0), 700.0)))
    mode = float(grid[int(np.argmax(weight))])
    off = angle - mode
    off -= turn * np.round(off / turn)
    agree = np.abs(off) <= AGREEMENT * std
    worth = np.where(agree, 1 / std**2, 0.0)
    if not agree.any():  # between two angles that contradict each other
        worth = 1 / std**2
    mean = float(worth @ off / worth.sum())
    # Where they scatter by more than they should, the common angle is known by so much less.
    scatter = float(worth @ (off - mean) ** 2) / max(int(np.count_nonzero(worth)) - 1, 1)
    spread = math.sqrt(max(scatter, 1.0) / float(worth.sum()))
    return AngleBelief(same, (mode + mean) % turn, spread)


def together(old: Sequence[FoundAngle], new: Sequence[FoundAngle], turn: float) -> list[FoundAngle]:
    """The angles found before and now, the latest; one for each experiment, the new one first."""
    numbers = {s.number for s in new}
    usable = [
        FoundAngle(s.number, s.angle % turn, max(s.std, LEAST_STD))
        for s in new
        if s.std < MOST_STD * turn
    ]
    return [*(s for s in old if s.number not in numbers), *usable][-MOST_ANGLES:]
