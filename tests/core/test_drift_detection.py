"""Recall and precision, on streams whose answer is known by hand."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.lab.study.drift_detection import detection, drifts_of

numbers = st.lists(st.integers(1, 60), max_size=12)


@pytest.mark.parametrize(
    ("drifts", "positives", "expected_recall", "expected_precision"),
    [
        ([10], [10], 1.0, 1.0),  # the drift's own experiment is the first of the five
        ([10], [14], 1.0, 1.0),  # the fifth
        ([10], [15], 0.0, 0.0),  # too late
        ([10], [9], 0.0, 0.0),  # before it
        ([10, 50], [14, 30, 55], 0.5, 1 / 3),
        ([10], [11, 12, 13], 1.0, 1 / 3),  # the second and third reveal nothing new
        ([10, 12], [13], 1.0, 1.0),  # one positive for two drifts
        ([10, 12], [11, 13], 1.0, 1.0),  # one each
        ([10], [], 0.0, None),
        ([], [10], None, 0.0),
        ([], [], None, None),
    ],
)
def test_recall_and_precision_by_hand(drifts, positives, expected_recall, expected_precision):
    """A positive within the next five experiments detects a drift; the first reveals it."""
    found = detection(drifts, positives)
    assert (found.recall, found.precision) == (expected_recall, expected_precision)


def test_the_paper_s_hybrid_table_row_is_possible():
    """Three of nine drifts found by 25 positives: recall 0.33 and precision 0.12, as printed."""
    drifts = range(20, 200, 20)
    positives = [20, 41, 64, *range(69, 80), *range(89, 100)]
    found = detection(drifts, positives)
    assert (found.drifts, found.detected, found.positives) == (9, 3, 25)
    assert (round(found.recall, 2), round(found.precision, 2)) == (0.33, 0.12)


@given(numbers, numbers)
def test_a_further_positive_never_loses_a_drift(drifts, positives):
    """Recall grows with the positives, and no positive reveals more than it can."""
    found = detection(drifts, positives)
    more = detection(drifts, [*positives, 30])
    assert more.detected >= found.detected
    assert found.revealing <= min(found.detected, found.positives)
    assert found.detected <= found.drifts


@given(numbers, numbers, st.integers(0, 100))
def test_only_distances_count(drifts, positives, shift):
    """Experiments may be numbered from anywhere."""
    moved = detection([d + shift for d in drifts], [p + shift for p in positives])
    assert moved == detection(drifts, positives)


def test_drifts_are_where_the_value_is_new():
    """A drift at i: experiment i is the first with the new value; the first experiment is none."""
    assert drifts_of([0.0, 0.0, 0.1, 0.1, 0.3, 0.3]) == [3, 5]
    assert drifts_of([0.2]) == drifts_of([]) == []
    assert drifts_of([0.0, 1.0], first=11) == [12]
