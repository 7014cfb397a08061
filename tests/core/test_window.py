"""The window detector goes by the calendar."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.base.errors import OptionError
from ldt_core.detectors.window import Window


@given(st.integers(1, 20), st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60))
def test_every_window_ends_with_a_positive(window, residuals):
    """Positive at experiments W, 2 W, 3 W, … and a warning in between, whatever the error."""
    detector = Window(window)
    for i, residual in enumerate(residuals, start=1):
        detector.update(residual)
        assert detector.signal == (1 if i % window == 0 else 0)


@pytest.mark.parametrize("window", [0, -3, 1.5, "10", True])
def test_a_bad_window_is_named(window):
    """The sentence names the argument and the value."""
    with pytest.raises(OptionError, match=f"window.*{window}"):
        Window(window)
