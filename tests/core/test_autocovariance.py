"""Claims about the noise that a calibration tells: white, with a memory, or both at once."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from ldt_core.calibration.autocovariance import autocovariance

LENGTH, COUNT, DRAWS = 300, 4, 20


def recorded(seed, white, memory, length=LENGTH):
    """Residuals of four experiments: so much of their power 1 is white, the rest AR(1)."""
    random = np.random.default_rng(seed)
    found = []
    for _ in range(COUNT):
        driven = math.sqrt((1 - white) * (1 - memory**2)) * random.standard_normal(length + 1000)
        slow = lfilter([1.0], [1.0, -memory], driven)[1000:]
        found.append(math.sqrt(white) * random.standard_normal(length) + slow)
    return found


def slow_deviation(values):
    """Of white noise that is as strong at the lowest frequencies."""
    return math.sqrt(2 * float(values.sum()) - float(values[0]))


def true_values(white, memory):
    values = (1 - white) * memory ** np.arange(LENGTH)
    values[0] = 1.0
    return values


@pytest.mark.parametrize(
    ("white", "memory"), [(1.0, 0.0), (0.0, 0.9), (0.0, 0.97), (0.5, 0.9), (0.5, 0.97), (0.5, 0.99)]
)
def test_the_slow_part_is_told_as_large_as_it_is(white, memory):
    """In the median of 20 recordings within a fifth; an autoregression has two thirds of a sum."""
    found = [
        slow_deviation(autocovariance(recorded(s, white, memory), LENGTH).values)
        for s in range(DRAWS)
    ]
    true = slow_deviation(true_values(white, memory))
    assert np.median(found) == pytest.approx(true, rel=0.2)


def test_each_noise_is_called_what_it_is():
    """White, a memory, and both, in most of 20 recordings."""
    for white, memory, name in (
        (1.0, 0.0, "AR(0)"),
        (0.0, 0.9, "AR(1)"),
        (0.5, 0.97, "white + AR(1)"),
    ):
        told = [autocovariance(recorded(s, white, memory), LENGTH) for s in range(DRAWS)]
        assert sum(t.method == name for t in told) >= DRAWS - 3
        assert all(t.white == (t.method == "AR(0)") for t in told)


def test_lengths_may_differ_and_nothing_is_no_noise():
    """Lags beyond a short experiment follow from the process; zeros give zeros."""
    parts = [*recorded(1, 0.5, 0.9), *recorded(2, 0.5, 0.9, length=101)]
    values = autocovariance(parts, 500).values
    assert values.shape == (500,)
    assert values[0] == pytest.approx(1.0, rel=0.3)
    assert values[-1] < 1e-3
    assert not autocovariance([np.zeros(50)] * 2, 50).values.any()
