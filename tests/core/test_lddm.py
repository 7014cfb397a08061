"""LDDM is eq. 6-8 of the paper, and river's DDM where the two agree."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.detectors.lddm import LDDM

bits = st.lists(st.booleans(), min_size=1, max_size=12)


def signals(detector, stream):
    """The answers to a stream of experiments."""
    answers = []
    for residual in stream:
        detector.update(residual)
        answers.append(int(detector.signal))
    return answers


def by_the_book(stream, literal):
    """Eq. 6-8 from the whole history of booleans, without any register of the class."""
    answers, history, lowest = [], [], None
    for wrong in stream:
        history = history + list(wrong)
        p = sum(history) / len(history)
        s = math.sqrt(p * (1 - p) / len(history))
        first = lowest is None
        if first or p + s < sum(lowest):
            lowest = (p, s)
        p_min, s_min = lowest
        answer = 1 if p + s >= p_min + 3 * s_min else 0 if p + s >= p_min + 2 * s_min else -1
        if not literal and (first or p == 0):
            answer = -1
        answers.append(answer)
        if answer == 1:
            history, lowest = [], None
    return answers


@given(st.lists(bits, min_size=1, max_size=25), st.booleans())
def test_the_answer_is_the_paper_s(stream, literal):
    """Experiments of any length: the answers follow from the whole history since a positive."""
    detector = LDDM(error_threshold=1.0, literal=literal)
    residuals = [np.where(wrong, -1.5, 0.5) for wrong in stream]
    assert signals(detector, residuals) == by_the_book(stream, literal)


@given(st.lists(st.booleans(), min_size=1, max_size=150))
def test_registers_are_those_of_river_s_ddm(stream):
    """One sample per experiment: p, s, both registers and the answer agree up to the first drift.

    The stream begins with one error and one hit, so that s > 0 from there on: at s = 0 the two
    differ on purpose (river compares with ">", the paper with "≥").
    """
    binary = pytest.importorskip("river.drift.binary")
    ours, theirs = LDDM(error_threshold=0.5), binary.DDM(warm_start=0)
    for wrong in [True, False, *stream]:
        ours.update([float(wrong)])
        theirs.update(wrong)
        got = ours.statistics
        assert got["error_rate"] == pytest.approx(theirs._p.get(), abs=1e-12)
        assert got["p_min"] == pytest.approx(theirs._p_min, abs=1e-12)
        assert got["s_min"] == pytest.approx(theirs._s_min, abs=1e-12)
        limits = (got["warning_limit"], got["drift_limit"])
        if min(abs(got["p_plus_s"] - limit) for limit in limits) > 1e-9:  # not a matter of rounding
            assert ours.drift_detected == theirs.drift_detected
            assert ours.warning_detected == theirs.warning_detected
        if ours.drift_detected or theirs.drift_detected:
            break


@given(st.permutations([0.0] * 30 + [2.0] * 10))
def test_only_the_share_of_errors_counts(residual):
    """The order of samples inside an experiment does not matter."""
    detector, sorted_one = LDDM(), LDDM()
    for row in ([0.0] * 39 + [2.0], residual):
        detector.update(row)
        sorted_one.update(sorted(row))
    assert detector.state() == sorted_one.state()


def test_an_error_free_stream_is_never_positive():
    """With p = s = 0 the paper's "≥" holds with equality; the safe default does not fall for it."""
    assert signals(LDDM(), [np.zeros(100)] * 200) == [-1] * 200


def test_the_literal_mode_is_positive_at_zero_error():
    """To the letter, 200 error-free experiments are 200 positives."""
    assert signals(LDDM(literal=True), [np.zeros(100)] * 200) == [1] * 200


def test_the_first_experiment_is_never_above_negative():
    """No register has been set by an earlier experiment, even if every sample is wrong."""
    assert signals(LDDM(), [np.full(100, 9.0)]) == [-1]
    assert signals(LDDM(literal=True), [np.full(100, 9.0)]) == [1]


def test_the_first_experiment_after_a_positive_is_never_above_negative():
    """A positive empties the registers."""
    right, wrong = np.zeros(100), np.full(100, 9.0)
    assert signals(LDDM(), [right, wrong, wrong, right]) == [-1, 1, -1, -1]


def test_after_error_free_experiments_the_first_error_is_positive():
    """A documented trap: p_min = s_min = 0 has no spread that would allow for it."""
    one_error = np.r_[np.zeros(99), 2.0]
    assert signals(LDDM(), [np.zeros(100)] * 10 + [one_error])[-1] == 1


def test_a_late_drift_takes_longer():
    """Dilution: the rate doubles after 5 or after 100 experiments of 10 % errors."""
    usual, worse = np.repeat([2.0, 0.0], [10, 90]), np.repeat([2.0, 0.0], [20, 80])
    early = signals(LDDM(), [usual] * 5 + [worse] * 60)
    late = signals(LDDM(), [usual] * 100 + [worse] * 60)
    assert early.index(1) - 5 < late.index(1) - 100


@pytest.mark.parametrize(
    ("seed", "warnings", "positives"),
    [
        (2, [43], [44]),
        (3, [12, 13, 14, 15, 16, 22, 43, 44, 45, 46], [17, 47]),  # 17 is a false alarm
        (4, [43, 44, 45, 51, 57], [46]),
    ],
)
def test_indices_on_seeded_streams(seed, warnings, positives):
    """Pinned: noise of 0.6 rad/s grows to 0.75 rad/s after experiment 40."""
    rng = np.random.default_rng(seed)
    stream = [rng.normal(0, 0.6 if i <= 40 else 0.75, 200) for i in range(1, 61)]
    answers = signals(LDDM(error_threshold=1.0), stream)
    assert [i for i, answer in enumerate(answers, start=1) if answer == 0] == warnings
    assert [i for i, answer in enumerate(answers, start=1) if answer == 1] == positives


def test_a_state_in_which_learning_did_not_help_is_never_the_reference():
    """One sample in fifty is off, then every other one without a new model, then as before."""
    detector, words = LDDM(error_threshold=1.0), []
    for off in [2] * 10 + [50] * 33 + [2] * 5:
        detector.update(np.repeat([2.0, 0.0], [off, 100 - off]))
        words.append(detector.signal.word)
        assert detector.p_min <= 0.02
        if detector.drift_detected:
            detector.answered(False)
    assert words == ["negative"] * 10 + ["positive"] * 33 + ["negative"] * 5


def test_a_new_model_begins_anew():
    """Its rate is its own."""
    detector = LDDM(error_threshold=1.0)
    for off in [2] * 10 + [50]:
        detector.update(np.repeat([2.0, 0.0], [off, 100 - off]))
    assert detector.drift_detected
    detector.answered(True)
    detector.update(np.repeat([2.0, 0.0], [10, 90]))
    assert (detector.p_min, detector.samples) == (0.1, 100)
