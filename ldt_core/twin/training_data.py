"""Which experiments to learn from: what is still valid, and enough of it.

The paper learns from the warning set and the present experiment. Here each recent experiment counts
as long as a model of the present machine explains it as well as the present one (compare
Klinkenberg, Joachims, "Detecting concept drift with support vector machines", ICML 2000).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ldt_core.base.experiment import Experiment, Samples, rms
from ldt_core.detectors.adequacy import ENOUGH_TO_LEARN
from ldt_core.models.base import Model

#: Least share of the recent operating range that the data learned from must have visited.
LEAST_COVERAGE = 0.5
#: Parts into which the range of each quantity is divided.
RANGE_BINS = 10
#: Share of the samples at either end of the range that may be outliers.
OUTLIER_SHARE = 0.01
#: Largest ratio of errors up to which an older experiment is valid. Between experiments of one
#: machine with random voltage the error of one model varies by about half.
VALID_ERROR_RATIO = 1.5
#: Largest ratio of errors on the present experiment up to which older ones join: 5 % is what the
#: error of some 200 independent samples varies by anyway.
JOINT_ERROR_RATIO = 1.05


def too_short(told: Sequence[Experiment]) -> bool:
    """Whether experiments have too few samples together to learn from."""
    return sum(map(len, told)) < ENOUGH_TO_LEARN


def newest_enough(told: Sequence[Experiment], fewest: int = 1) -> list[Experiment]:
    """The last of these, as many as it takes to have enough samples; all if they have not."""
    first = max(len(told) - fewest, 0)
    while first > 0 and too_short(told[first:]):
        first -= 1
    return list(told[first:])


def coverage(pool: Sequence[Experiment], recent: Sequence[Experiment]) -> float:
    """Share of the recent samples whose voltage, and whose speed, the pool has visited as well.

    The lesser of the two, each counted in tenths of the recent range: 1 when the pool has been
    wherever the machine was lately, 0 to 0.1 when it stood still at one point of a wide range.
    """
    return min(
        _visited([getattr(e, name) for e in pool], [getattr(e, name) for e in recent])
        for name in ("voltage", "speed")
    )


def _visited(pool: Sequence[Samples], recent: Sequence[Samples]) -> float:
    samples = np.concatenate(recent)
    low, high = np.quantile(samples, [OUTLIER_SHARE, 1 - OUTLIER_SHARE])
    if not high > low:
        return 1.0
    edges = np.linspace(low, high, RANGE_BINS + 1)[1:-1]
    seen = np.bincount(np.digitize(np.concatenate(pool), edges), minlength=RANGE_BINS) > 0
    return float(seen[np.digitize(samples, edges)].mean())


def core(present: Experiment, recent: Sequence[Experiment]) -> list[Experiment]:
    """The present experiment, and as many of the last ones as it takes to cover the range.

    Args:
        present: the experiment that showed the drift.
        recent: those before it, the last one last.

    Returns:
        In the order in which they came, the present one last; everything when nothing less covers.
    """
    pool = [present]
    for experiment in reversed(recent):
        if coverage(pool, [*recent, present]) >= LEAST_COVERAGE:
            break
        pool.insert(0, experiment)
    return pool


def still_valid(model: Model, rmse: float, recent: Sequence[Experiment]) -> list[Experiment]:
    """The experiments that a model of the present machine explains.

    Args:
        rmse: its error on samples of it that were held back [rad/s].
        recent: experiments that it has not learned from.
    """
    return [e for e in recent if rms(model.predict(e).residual(e)) <= VALID_ERROR_RATIO * rmse]
