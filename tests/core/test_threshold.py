"""The threshold detector is eq. 5 of the paper."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.detectors.threshold import Threshold

residuals = st.lists(st.floats(-10, 10), min_size=1, max_size=20)


@given(residuals, st.floats(0, 10), st.floats(0, 1))
def test_the_answer_is_the_paper_s(residual, threshold, share):
    """1 if f_m > θ_c, else 0 if f_m > θ_w, else -1, computed by hand."""
    detector = Threshold(threshold, share * threshold)
    detector.update(residual)
    worst = max(abs(r) for r in residual)
    expected = 1 if worst > threshold else 0 if worst > share * threshold else -1
    assert detector.signal == expected
    assert detector.statistics["max_error"] == worst


@given(st.lists(residuals, min_size=1, max_size=10), st.floats(0, 5), st.floats(0, 5))
def test_a_higher_threshold_never_answers_more_strongly(stream, low, more):
    """The answer is monotone in θ_c."""
    strict, lax = Threshold(low), Threshold(low + more)
    for residual in stream:
        strict.update(residual)
        lax.update(residual)
        assert lax.signal <= strict.signal


@pytest.mark.parametrize(("worst", "expected"), [(1.5, -1), (1.5001, 0), (3.0, 0), (3.0001, 1)])
def test_limits_are_exceeded_not_reached(worst, expected):
    """At the limit itself the weaker answer holds; the warning limit defaults to half."""
    detector = Threshold(threshold=3.0)
    detector.update([0.0, -worst])
    assert detector.signal == expected


def test_it_has_no_memory():
    """The same experiment gets the same answer after any history."""
    detector = Threshold(1.0)
    for residual in ([5.0], [0.0], [0.7]):
        detector.update(residual)
    assert detector.warning_detected
    assert not detector.drift_detected


def test_without_a_warning_level_it_does_not_warn():
    """θ_w = θ_c leaves no room for a warning."""
    detector = Threshold(1.0, 1.0)
    for worst in np.linspace(0, 2, 21):
        detector.update([worst])
        assert detector.signal != 0
