"""Figures over cases with their 95 % intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from ldt_core.lab.study.statistics import CONFIDENCE, UNKNOWN, Interval

DRAWS = 2000  # of cases, with replacement


def share(right: Sequence[bool]) -> Interval:
    """Share of those that are right, with Wilson's interval.

    >>> share([True, True, False, False]).value
    0.5
    """
    if not right:
        return UNKNOWN
    interval = binomtest(sum(right), len(right)).proportion_ci(CONFIDENCE, "wilson")
    return Interval(sum(right) / len(right), float(interval.low), float(interval.high), len(right))


def resampled(
    cases: Sequence[Sequence[float]],
    statistic: Callable[[NDArray[np.float64]], float],
    seed: int = 0,
) -> Interval:
    """A statistic of all values, with the percentile interval of draws of whole cases.

    Args:
        cases: values of each case; those without any are left out.
        statistic: of (n,) values.
        seed: of the draws.
    """
    known = [np.asarray(values, dtype=np.float64) for values in cases if len(values)]
    if not known:
        return UNKNOWN
    value, count = float(statistic(np.concatenate(known))), len(known)
    if count == 1:
        return Interval(value, -math.inf, math.inf, 1)
    picks = np.random.default_rng(seed).integers(0, count, (DRAWS, count))
    if all(v.size == 1 for v in known):
        flat = np.concatenate(known)
        drawn = [float(statistic(flat[pick])) for pick in picks]
    else:
        drawn = [float(statistic(np.concatenate([known[k] for k in pick]))) for pick in picks]
    tail = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(drawn, [tail, 100 - tail], method="nearest")
    return Interval(value, float(low), float(high), count)
