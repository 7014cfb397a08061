"""The range of excitation that a model has been tried in, and what lies outside it.

A range is the hull of the voltage and of its distance from its own running means.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array

#: Times [samples] over which the voltage's mean is taken: how fast it changes shows against each.
MEMORIES = (3, 30, 300)
#: Part of the range seen, or of its size, by which a voltage beyond it is still known: a model
#: whose error grows in proportion errs by as much more there.
MARGIN = 0.1
#: Samples after one outside the range that count as outside too, as a part of the experiment: a
#: free run remembers.
AFTER = 0.05


Hull = list[list[float]]


def hull(voltage: Array) -> Hull:
    """[lowest, highest] of each quantity in a voltage (L,) [V]."""
    seen = _quantities(voltage)
    return [seen.min(axis=0).tolist(), seen.max(axis=0).tolist()]


def is_hull(value: object) -> bool:
    """Whether a value in JSON types is one, or the empty one of what was seen nowhere."""
    if value == []:
        return True
    try:
        low, high = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        return False
    whole = np.isfinite(low).all() and np.isfinite(high).all()
    return bool(low.shape == (1 + len(MEMORIES),) and whole and (low <= high).all())


def joined(one: Hull, other: Hull) -> Hull:
    """The hull of two, neither empty."""
    return [np.minimum(one[0], other[0]).tolist(), np.maximum(one[1], other[1]).tolist()]


def inside(one: Hull, other: Hull) -> bool:
    """Whether all of a voltage with the one hull is `within` the other; neither is empty."""
    low, high = np.array(other)
    slack = _slack(low, high)
    return not ((one[0] < low - slack) | (one[1] > high + slack)).any()


def samples_within(voltage: Array, range_: Hull) -> NDArray[np.bool_]:
    """(L,) samples of a voltage (L,) [V] inside a hull; all inside an empty one."""
    if not range_:
        return np.ones(voltage.size, dtype=bool)
    low, high = np.array(range_)
    slack = _slack(low, high)
    seen = _quantities(voltage)
    outside = ((seen < low - slack) | (seen > high + slack)).any(axis=1)
    wide = max(1, round(AFTER * voltage.size))
    sample = np.arange(voltage.size)
    last = np.maximum.accumulate(np.where(outside, sample, -wide))  # one outside, up to each
    return np.asarray(sample - last >= wide)


def _slack(low: Array, high: Array) -> Array:
    return np.asarray(MARGIN * np.maximum(high - low, np.abs(high)))


def _quantities(voltage: Array) -> Array:
    """(L, 4) voltage, and its size of distance from each running mean [V]."""
    columns = [voltage]
    for memory in MEMORIES:
        columns.append(np.abs(voltage - _running_mean(voltage, memory)))
    return np.stack(columns, axis=1)


def _running_mean(voltage: Array, memory: int) -> Array:
    """Mean over the last samples, before the first of which the voltage was what it is there."""
    padded = np.concatenate([np.full(memory, voltage[0]), voltage])
    total = np.cumsum(padded)
    return np.asarray((total[memory:] - total[:-memory]) / memory)
