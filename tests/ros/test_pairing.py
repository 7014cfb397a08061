"""Two topics brought together by number."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rclpy")

from ldt_ros.nodes.pairing import Pairing

SIDES = st.lists(st.tuples(st.booleans(), st.integers(1, 12)), max_size=60)


@given(SIDES)
def test_pairing_brings_the_first_of_each_side_together_once(arrivals):
    """In any order of arrival, each number once; what is lost is counted, as long as all fit."""
    met: list[tuple[str, str]] = []
    pairing: Pairing[str, str] = Pairing(lambda left, right: met.append((left, right)))
    waiting: dict[tuple[bool, int], str] = {}
    expected, dropped, repeated = [], 0, 0
    done: set[int] = set()
    for index, (is_left, number) in enumerate(arrivals):
        item = f"{number} at {index}"
        (pairing.left if is_left else pairing.right)(number, item)
        other = waiting.pop((not is_left, number), None)
        if other is not None:
            expected.append((item, other) if is_left else (other, item))
            done.add(number)
        elif number in done:
            repeated += 1
        elif (is_left, number) in waiting:
            dropped += 1
        else:
            waiting[is_left, number] = item
    assert met == expected
    assert (pairing.dropped, pairing.repeated) == (dropped, repeated)


@given(SIDES, st.integers(1, 5))
def test_pairing_is_bounded_and_counts_what_it_drops(arrivals, capacity):
    """However many never find their other half; every half met, waits, or was counted."""
    met: list[int] = []
    pairing: Pairing[int, int] = Pairing(lambda left, right: met.extend((left, right)), capacity)
    for is_left, number in arrivals:
        (pairing.left if is_left else pairing.right)(number, number)
        assert len(pairing) <= 2 * capacity
    assert len(met) + len(pairing) + pairing.dropped + pairing.repeated == len(arrivals)
