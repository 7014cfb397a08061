"""Figures of a run, on streams whose answer is known by hand."""

import doctest

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.base import metrics
from ldt_core.base.experiment import (
    Action,
    Adaptation,
    Experiment,
    Level,
    Prediction,
    Signal,
    Step,
)
from ldt_core.base.metrics import (
    FreeRunError,
    Summary,
    detection,
    drifts_of,
    precision,
    recall,
    summarise,
)

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
    assert recall(drifts, positives) == expected_recall
    assert precision(drifts, positives) == expected_precision


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


def step(number, error, original_error, level, action, version):
    """One turn of the loop with constant errors [rad/s]."""
    experiment = Experiment(number, 0.0, 0.1, [1.0, 1.0], [5.0, 5.0])
    prediction = Prediction(number, 0.0, 0.1, version, [5.0, 5.0 - error])
    original = Prediction(number, 0.0, 0.1, 0, [5.0 + original_error, 5.0])
    signal = Signal(number, level, "by hand", version, prediction.max_error(experiment))
    done = Adaptation(number, action, version, "by hand")
    return Step(experiment, prediction, original, signal, done)


def test_a_run_by_hand():
    """Four experiments: MME is the mean of 1, 2, 4, 1 and that of the original of 1, 2, 4, 8."""
    summary = summarise(
        [
            step(1, 1.0, 1.0, Level.NEGATIVE, Action.KEPT, 0),
            step(2, 2.0, 2.0, Level.WARNING, Action.STORED, 0),
            step(3, 4.0, 4.0, Level.POSITIVE, Action.REFUSED, 0),
            step(4, 1.0, 8.0, Level.POSITIVE, Action.ADAPTED, 1),
        ]
    )
    assert summary.as_dict() == {
        "experiments": 4,
        "mme": 2.0,
        "mme_original": 3.75,
        "positives": 2,
        "warnings": 1,
        "negatives": 1,
        "adaptations": 1,
        "refusals": 1,
        "model_version": 1,
        "rejected": 0,
        "repeated": 0,
        "diagnoses": [],
        "advice": None,
        "notes": [],
    }
    assert ("MME of the learning twin [rad/s]", "2.000") in summary.rows()
    assert ("signals: positive", "2") in summary.rows()


def test_record_by_record_is_the_same():
    """A recording gives signals, original errors and adaptations each on its own topic."""
    steps = [
        step(1, 1.0, 3.0, Level.NEGATIVE, Action.KEPT, 0),
        step(2, 2.5, 3.0, Level.POSITIVE, Action.ADAPTED, 1),
    ]
    apart = Summary()
    for one in steps:
        apart.add_adaptation(one.adaptation)
    for one in steps:
        apart.add_signal(one.signal)
    for one in steps:
        apart.add_original(one.original.max_error(one.experiment))
    assert apart.as_dict() == summarise(steps).as_dict()


def test_of_nothing_nothing_is_known():
    """A mean over no experiments is None, not 0."""
    assert (Summary().mme, Summary().mme_original, Summary().experiments) == (None, None, 0)
    assert ("MME of the original model [rad/s]", "-") in Summary().rows()


def test_rejected_experiments_are_counted_and_the_first_says_why():
    """A thousand bad experiments are one note and a number."""
    summary = Summary()
    for number in (3, 4, 5):
        summary.reject(f"experiment {number}")
    for _ in range(2):
        summary.note("the machine file was older")
    assert summary.rejected == 3
    assert summary.notes == ["rejected experiment 3", "the machine file was older"]


def test_errors_of_free_runs_by_hand():
    """RMSE weighs samples, the mean of the maxima weighs experiments."""
    error = FreeRunError()
    error.add(np.array([3.0, -4.0]))
    error.add(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.0]))
    expected = {"experiments": 2, "rmse": np.sqrt(29 / 8), "mean_max_error": 3.0}
    assert error.as_dict() == pytest.approx(expected)


def test_examples_are_true():
    """The docstrings' examples run as printed."""
    result = doctest.testmod(metrics)
    assert result.attempted > 0
    assert result.failed == 0
