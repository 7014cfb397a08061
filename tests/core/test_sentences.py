"""Names and numbers in sentences."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from ldt_core.base.sentences import ranges, spans


@given(st.sets(st.integers(1, 60)))
def test_ranges_name_each_number_once(numbers):
    """What is written can be read back."""
    told = ranges(spans(numbers))
    found: set[int] = set()
    for part in [] if told == "none" else told.split(", "):
        first, _, last = part.partition(" to ")
        found |= set(range(int(first), int(last or first) + 1))
    assert found == numbers


@given(st.sets(st.integers(1, 60)), st.integers(1, 5))
def test_what_is_not_shown_is_counted(numbers, most):
    """Shown and counted together are all."""
    told = ranges(spans(numbers), most)
    shown = sum(b - a + 1 for a, b in spans(numbers)[:most])
    _, _, rest = told.partition(" and ")
    assert shown + int(rest.partition(" ")[0] or 0) == len(numbers)
