"""Whatever comes is refused or let through; thousands of it by `python -m tests.fuzz`."""

from __future__ import annotations

import pytest

from tests.fuzz import KINDS, fuzz

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_that_comes_from_outside_is_a_crash(kind):
    """Messages, experiments that go through the loop, and machine files of every sort."""
    told = fuzz(kind, 150, 1)
    assert told.total() == 150
    assert any("refused" in what for what in told)
    assert any("let through" in what for what in told)
