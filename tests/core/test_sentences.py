"""Names and numbers in sentences."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from ldt_core.base.sentences import gaps, ranges, spans


@given(st.sets(st.integers(1, 60)))
def test_ranges_name_each_number_once(numbers):
    """What is written can be read back."""
    told = ranges(spans(numbers))
    found: set[int] = set()
    for part in [] if told == "none" else told.split(", "):
        first, _, last = part.partition(" to ")
        found |= set(range(int(first), int(last or first) + 1))
    assert found == numbers


@given(st.sets(st.integers(1, 60), min_size=1))
def test_numbers_and_gaps_fill_the_whole_range(numbers):
    """Nothing twice, nothing left out."""
    there = [n for a, b in [*spans(numbers), *gaps(numbers)] for n in range(a, b + 1)]
    assert sorted(there) == list(range(min(numbers), max(numbers) + 1))


@given(st.sets(st.integers(1, 60)), st.integers(1, 5))
def test_what_is_not_shown_is_counted(numbers, most):
    """Shown and counted together are all."""
    told = ranges(spans(numbers), most)
    shown = sum(b - a + 1 for a, b in spans(numbers)[:most])
    _, _, rest = told.partition(" and ")
    assert shown + int(rest.partition(" ")[0] or 0) == len(numbers)
