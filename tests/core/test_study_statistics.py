"""Intervals: they hold what they promise, and say when there is nothing to say."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ldt_core.base.sentences import number
from ldt_core.lab.statistics import (
    UNKNOWN,
    geometric_mean,
    mean,
    proportion,
    rank_correlation,
    rate,
)
from ldt_core.lab.statistics import trend as trend_of


def test_the_mean_of_a_table():
    """1, 2, 3: t(0.975, 2) = 4.303 standard errors of 1 / sqrt(3)."""
    found = mean([1.0, 2.0, None, 3.0])
    half = 4.302653 / math.sqrt(3)
    assert (found.value, found.count) == (2.0, 3)
    assert (found.low, found.high) == pytest.approx((2 - half, 2 + half), rel=1e-6)


def test_the_interval_holds_the_truth_in_19_of_20_cases():
    """1000 samples of 20 normal values."""
    drawn = np.random.default_rng(0).normal(3.0, 2.0, (1000, 20))
    found = [mean(row) for row in drawn]
    assert np.mean([e.low <= 3.0 <= e.high for e in found]) == pytest.approx(0.95, abs=0.02)


def test_one_value_says_nothing_of_its_spread():
    """The interval is everything; of no values there is no mean either."""
    assert (mean([3.0]).low, mean([3.0]).high) == (-math.inf, math.inf)
    assert mean([]) == mean([None]) == UNKNOWN
    assert UNKNOWN.text() == "unknown"
    assert mean([3.0]).as_dict() == {"value": 3.0, "low": None, "high": None, "count": 1}


def test_equal_values_have_an_interval_of_no_width():
    """Rounding in 0.1 + 0.1 + 0.1 is no spread."""
    found = mean([0.1] * 7)
    assert found.low == found.high == found.value == pytest.approx(0.1)


def test_ratios_stand_one_failure_that_differences_do_not():
    """5 against 4 on 19 streams and 50 against 4 on one: better on each, and so by the ratio."""
    others = [5.0] * 19 + [50.0]
    assert mean([o - 4.0 for o in others]).low < 0
    share = geometric_mean([4.0 / o for o in others])
    assert share.value == pytest.approx(0.8 * 0.1 ** (1 / 20))
    assert share.high < 1
    assert geometric_mean([None, 0.0]) == UNKNOWN
    assert geometric_mean([1e-200, 1e200]).high == math.inf


def test_shares_and_rates_of_nothing_seen():
    """None of 30: at most 11.6 % (Clopper-Pearson); none in 100: at most 3.69 / 100 (Garwood)."""
    assert proportion(0, 30).low == rate(0, 100).low == 0
    assert proportion(0, 30).high == pytest.approx(0.1157, abs=1e-4)
    assert rate(0, 100).high == pytest.approx(0.03689, abs=1e-5)
    assert proportion(0, 0) == rate(0, 0) == UNKNOWN


def test_the_rate_of_a_table():
    """Ten events: 4.795 to 18.39 (Garwood's table)."""
    found = rate(10, 1)
    assert (found.low, found.high) == pytest.approx((4.795, 18.390), abs=1e-3)


def test_trends_by_hand():
    """Up in each row is 1, down is -1, constant is 0, two points are nothing."""
    up, down = ([1, 2, 3], [1.0, 5.0, 6.0]), ([1, 2, 3], [3.0, 2.0, 1.0])
    assert trend_of([up, up]).value == 1.0
    assert trend_of([up, down]).value == 0.0
    assert rank_correlation([1, 2, 3], [4.0, 4.0, 4.0]) == 0.0
    assert rank_correlation([1, 2], [1.0, 2.0]) is None
    assert trend_of([([1, 2], [1.0, 2.0])]) == UNKNOWN


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.000123456, "0.000123"),
        (6.8649, "6.86"),
        (44.0, "44.0"),
        (1234.5, "1234"),
        (-0.5, "-0.500"),
    ],
)
def test_numbers_for_people(value, text):
    """Three significant digits, no exponent."""
    assert number(value) == text
