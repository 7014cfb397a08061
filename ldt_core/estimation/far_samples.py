"""Where the samples far out lie: together, or behind the voltage's steps, they are no noise."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.estimation.noise import NORMAL_MEDIAN, NORMAL_NINTH

#: Two neighbours beyond so many deviations of the noise on one side are no noise of any usual law.
#: With half of it, noise in proportion to the speed would come in blows.
FAR = 10.0
#: Samples within which far ones lie close together in a blow, and how many times the odds are
#: higher there, of the blows that the e-value is sensitive to.
CLOSE, CLOSER = (1, 5, 25), (2.0, 8.0, 32.0)
#: The same close behind a step: later, noise in proportion to the speed is larger, too.
BEHIND = CLOSE[:2]
#: Part of the largest step of the voltage from which on a step counts as a large one.
LARGE_STEP = 0.5
#: Such parts of which a step has far samples behind it, that the e-value is sensitive to.
STEPS = (LARGE_STEP, 0.1)
#: Roughness [of the residual's largest value] below which it is rounding and no noise.
ROUNDING = 1e-9
#: Largest logarithm of an e-value: sums and products of two are still numbers.
MOST_LOG = 300.0


def in_blows(row: Array, quiet: float, claimed: Array, moves: Array | None = None) -> float:
    """e-value of where the far samples of (L,) lie, given how many are far: close together, or
    close behind the voltage's steps.

    In any order equally likely, the next sample is far with the chance of those that are left. Bets
    that the odds are higher there multiply to an e-value (Shafer, "Testing by betting", Journal of
    the Royal Statistical Society A 184, 2021). The mean of two is one.

    Args:
        quiet: deviation of the sensor's noise, in the unit of the row; 0 takes the samples' own.
        claimed: (L,) variance beyond it that the model claims, in that unit. What is far lies `FAR`
            deviations of both from zero, behind steps half of it.
        moves: as of `Setting`; None where nothing of it is known.
    """
    size = np.abs(row)
    noise = max(quiet or float(np.median(size)) / NORMAL_MEDIAN, ROUNDING)
    beyond = FAR * np.sqrt(noise**2 + claimed)
    out = size > beyond
    found = [_won(out, out, CLOSE)] if np.count_nonzero(out) > 1 else []
    out = size > LARGE_STEP * beyond
    if moves is not None and out.any() and (step := np.abs(moves[:, 1])).any():
        stepped = np.append(step[1:], 0.0) / float(step.max())
        found.append(float(np.mean([_won(out, stepped > part, BEHIND) for part in STEPS])))
    return float(np.mean(found)) if found else 1.0


def _won(out: NDArray[np.bool_], after: NDArray[np.bool_], close: Sequence[int]) -> float:
    """What bets win on average that (L,) samples are far soon after these; half is not bet."""
    at = np.arange(out.size)
    left = np.count_nonzero(out) - np.cumsum(out) + out
    chance = left / (out.size - at)
    before = np.concatenate([[-out.size], np.maximum.accumulate(np.where(after, at, -out.size))])
    won = []
    for within in close:
        near = at - before[:-1] <= within
        together, odds = np.count_nonzero(out & near), chance[near]
        won += [together * math.log(k) - float(np.sum(np.log1p((k - 1) * odds))) for k in CLOSER]
    return float(1 + np.mean(np.exp(np.minimum(won, MOST_LOG)))) / 2


def outliers(row: Array, resolved: float, moves: Array) -> tuple[int, float]:
    """How many of (L,) samples are far out, and an e-value of where they lie.

    It is what bets win that half of them are close behind the voltage's steps: noise knows nothing
    of it. Drawn without replacement, they win less than with it (Hoeffding, Journal of the American
    Statistical Association 58, 1963). Nothing is won where most samples are behind steps.

    Args:
        resolved: deviation of what a coarse sensor rounds off, in the unit of the row.
        moves: as of `Setting`.
    """
    step = np.abs(moves[:, 1])
    # An encoder at rest shows no noise in more than half, and what comes in blows is in fewer.
    usual = float(np.quantile(np.abs(row), 0.9)) / NORMAL_NINTH
    out = np.abs(row) > FAR * max(usual, resolved, ROUNDING)
    stepped = step > STEPS[-1] * float(step.max())
    near = np.convolve(stepped, np.ones(BEHIND[-1]))[: row.size] > 0
    count, part = int(np.count_nonzero(out)), float(np.mean(near))
    if not count or not 0 < part < 0.5:
        return count, 1.0
    behind = np.count_nonzero(out & near)
    won = behind * math.log(0.5 / part) + (count - behind) * math.log(0.5 / (1 - part))
    return count, math.exp(min(won, MOST_LOG))


def far_behind_steps(row: Array, moves: Array) -> bool:
    """Whether most samples behind large steps of the voltage lie beyond their part of `FAR`."""
    for step in np.abs(moves[:, 1:]).T:
        large = step > LARGE_STEP * float(step.max())
        if large.any() and np.mean(np.abs(row[large]) > LARGE_STEP * FAR) > 0.5:
            return True
    return False
