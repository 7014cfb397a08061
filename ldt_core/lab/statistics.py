"""Intervals over seeds: a mean, a difference, a share, a rate, a trend.

Seeds are the independent unit: experiments of a stream, and drifts of it, are not. So a figure is
taken per seed first, and the interval is that of its mean over seeds, by Student's t. A bootstrap
(BCa) was the alternative: for twenty values its intervals are known to be too short, while t is
exact for normal values. Errors are compared by their ratio, whose mean is the geometric one: on a
few streams a model may fail altogether, and one MME of ten times the usual would leave a mean
difference without any meaning. Counts of rare events (false alarms) have exact intervals instead,
since most of their seeds have none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy import stats

from ldt_core.base.arrays import Array
from ldt_core.base.sentences import number

CONFIDENCE = 0.95
DRAWS = 2000  # of cases, with replacement, for a bootstrap
SEED = 0  # of the draws: any, and the same in every table
MOST_LOG = 700.0  # math.exp overflows above 709


@dataclass(frozen=True)
class Interval:
    """A figure with its interval.

    Attributes:
        value: the estimate; None when there was nothing to estimate it from.
        low: of the 95 % interval; -inf with fewer than two values.
        high: likewise, +inf.
        count: of the values it comes from.
    """

    value: float | None
    low: float
    high: float
    count: int

    def text(self, unit: str = "", digits: int = 3) -> str:
        """As "6.86 rad/s [6.10, 7.62]", with so many significant digits."""
        if self.value is None:
            return "unknown"
        return (
            f"{number(self.value, digits)}{f' {unit}' if unit else ''} "
            f"[{number(self.low, digits)}, {number(self.high, digits)}]"
        )

    def as_dict(self) -> dict[str, Any]:
        """For JSON: infinite bounds are None."""
        low, high = (v if math.isfinite(v) else None for v in (self.low, self.high))
        return {"value": self.value, "low": low, "high": high, "count": self.count}


UNKNOWN = Interval(None, -math.inf, math.inf, 0)


def mean(values: Iterable[float | None]) -> Interval:
    """Mean with Student's t interval, of the values that are not None.

    Values that are all the same have an interval of no width: they say nothing of their spread.
    """
    known = np.array([v for v in values if v is not None], dtype=np.float64)
    if known.size == 0:
        return UNKNOWN
    middle = float(known.mean())
    if known.size == 1:
        return Interval(middle, -math.inf, math.inf, 1)
    error = float(known.std(ddof=1)) / math.sqrt(known.size)
    if error <= np.finfo(float).eps * abs(middle):
        return Interval(middle, middle, middle, known.size)
    low, high = stats.t.interval(CONFIDENCE, known.size - 1, middle, error)
    return Interval(middle, float(low), float(high), known.size)


def geometric_mean(values: Iterable[float | None]) -> Interval:
    """Geometric mean of ratios with the t interval of their logarithm; those above 0 alone.

    >>> geometric_mean([0.5, 2.0]).value
    1.0
    """
    logs = mean(math.log(v) for v in values if v is not None and v > 0)
    if logs.value is None:
        return UNKNOWN
    low, high = (_exp(bound) for bound in (logs.low, logs.high))
    return Interval(math.exp(logs.value), low, high, logs.count)


def _exp(bound: float) -> float:
    # Of two or three values the interval may reach beyond any number.
    return math.exp(bound) if bound < MOST_LOG else math.inf


def proportion(part: int, whole: int, method: Literal["exact", "wilson"] = "exact") -> Interval:
    """Share with an interval: the exact one of Clopper and Pearson, or Wilson's.

    >>> proportion(2, 4, method="wilson").value
    0.5
    """
    if whole == 0:
        return UNKNOWN
    interval = stats.binomtest(part, whole).proportion_ci(CONFIDENCE, method)
    return Interval(part / whole, float(interval.low), float(interval.high), whole)


def rate(events: int, exposure: float) -> Interval:
    """Events per unit of exposure with the exact interval of a Poisson count (Garwood, 1936)."""
    if exposure <= 0:
        return UNKNOWN
    tail = (1 - CONFIDENCE) / 2
    low = float(stats.chi2.ppf(tail, 2 * events)) / 2 if events else 0.0
    high = float(stats.chi2.isf(tail, 2 * events + 2)) / 2
    return Interval(events / exposure, low / exposure, high / exposure, events)


def trend(rows: Iterable[tuple[Sequence[float], Sequence[float | None]]]) -> Interval:
    """Mean over rows (seeds) of Spearman's rank correlation of y with x.

    A row in which y is constant has no trend, 0. Points whose y is None are left out, and rows of
    fewer than three points.
    """
    return mean((rank_correlation(x, y) for x, y in rows))


def rank_correlation(x: Sequence[float], y: Sequence[float | None]) -> float | None:
    """Spearman's rank correlation; 0 where y is constant, None of fewer than three points.

    >>> round(rank_correlation([1, 2, 3, 4], [0.1, 0.2, None, 0.9]), 6)
    1.0
    """
    known = [(a, b) for a, b in zip(x, y, strict=True) if b is not None]
    if len({a for a, _ in known}) < 3:
        return None
    first, second = zip(*known, strict=True)
    if len(set(second)) == 1:
        return 0.0
    return float(stats.spearmanr(first, second).statistic)


def resampled(
    cases: Sequence[Sequence[float]],
    statistic: Callable[[Array], float],
) -> Interval:
    """A statistic of all values, with the percentile interval of draws of whole cases.

    Args:
        cases: values of each case; those without any are left out.
        statistic: of (n,) values.
    """
    known = [np.asarray(values, dtype=np.float64) for values in cases if len(values)]
    if not known:
        return UNKNOWN
    value, count = float(statistic(np.concatenate(known))), len(known)
    if count == 1:
        return Interval(value, -math.inf, math.inf, 1)
    picks = np.random.default_rng(SEED).integers(0, count, (DRAWS, count))
    if all(v.size == 1 for v in known):
        flat = np.concatenate(known)
        drawn = [float(statistic(flat[pick])) for pick in picks]
    else:
        drawn = [float(statistic(np.concatenate([known[k] for k in pick]))) for pick in picks]
    tail = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(drawn, [tail, 100 - tail], method="nearest")
    return Interval(value, float(low), float(high), count)
