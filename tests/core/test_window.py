"""The window detector goes by the calendar."""

from hypothesis import given
from hypothesis import strategies as st

from ldt_core.detectors.window import Window


@given(st.integers(1, 20), st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60))
def test_every_window_ends_with_a_positive(window, residuals):
    """Positive at experiments W, 2 W, 3 W, … and a warning in between, whatever the error."""
    detector = Window(window)
    for i, residual in enumerate(residuals, start=1):
        detector.update(residual)
        assert detector.signal == (1 if i % window == 0 else 0)
