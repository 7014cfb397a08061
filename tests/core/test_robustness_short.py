"""The default twin stays as good as it was on four streams."""

from __future__ import annotations

import json

import pytest

from tests.robustness_short import FILE, SHORT, left

#: Of the share written beside it that a share may have grown by.
GROWTH = 0.1


@pytest.mark.slow
@pytest.mark.parametrize("stream", SHORT)
def test_what_is_left_has_not_grown_by_a_tenth(stream):
    """Over the figure that `python -m tests.robustness_short` wrote."""
    assert left(stream) <= (1 + GROWTH) * json.loads(FILE.read_text())[stream]


def test_every_stream_has_its_figure():
    """And no other one stands in the file."""
    assert set(json.loads(FILE.read_text())) == set(SHORT)
