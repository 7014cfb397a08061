"""Two topics brought together by number."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rclpy")

from stranger import adaptation, answer, experiment, prediction

from ldt_core.base.errors import RecordingError
from ldt_core.recording.writer import BagWriter
from ldt_core.restart.checkpoint import Lookup
from ldt_ros.nodes.adaptor_node import AdaptorNode
from ldt_ros.nodes.detector_node import DetectorNode
from ldt_ros.nodes.pairing import Pairing

ABOUT = st.tuples(st.integers(1, 4), st.sampled_from((-5000.0, 0.0, 1000.0)))
SIDES = st.lists(st.tuples(st.booleans(), st.integers(1, 12)), max_size=60)
TIMED = st.lists(st.tuples(st.booleans(), ABOUT), max_size=60)


@given(SIDES.map(lambda sides: [(left, (number, None)) for left, number in sides]) | TIMED)
def test_pairing_brings_the_first_of_each_side_together_once(arrivals):
    """In any order of arrival, each number once, or each number and time where that is known.

    What is lost is counted, as long as all fit. What the twin refused keeps no later one of its
    number from its own: a counter that restarted twice, first with its clock behind.
    """
    met: list[tuple[str, str]] = []
    pairing: Pairing[str, str] = Pairing(lambda left, right: met.append((left, right)))
    waiting: dict[tuple[bool, tuple[int, float | None]], str] = {}
    expected, dropped, repeated = [], 0, 0
    done: set[tuple[int, float | None]] = set()
    for index, (is_left, about) in enumerate(arrivals):
        item = f"{about} at {index}"
        (pairing.left if is_left else pairing.right)(about[0], item, about[1])
        other = waiting.pop((not is_left, about), None)
        if other is not None:
            expected.append((item, other) if is_left else (other, item))
            done.add(about)
        elif about in done:
            repeated += 1
        elif (is_left, about) in waiting:
            dropped += 1
        else:
            waiting[is_left, about] = item
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


@pytest.mark.parametrize("complete", [0, 2])
@pytest.mark.parametrize(
    ("kind", "beside", "said", "replied"),
    [
        (DetectorNode, "prediction", prediction, "signal"),
        (AdaptorNode, "signal", answer, "adaptation"),
    ],
)
def test_what_a_node_can_no_longer_hear_it_reads(
    kind, beside, said, replied, complete, stranger, tmp_path
):
    """Who stood still while more came than a topic keeps answers all the same."""
    with BagWriter(tmp_path / "run", "rotor") as writer:
        for number in range(1, 6):
            writer.write("experiment", experiment(number), 1e9 + number)
            if number <= complete:
                writer.write("adaptation", adaptation(number), 1e9 + number)
    physics = {"model": "physics"} if kind is AdaptorNode else {}
    stranger.start(kind, bag=str(tmp_path / "run"), **physics)
    stranger.listen(replied)
    stranger.send("experiment", experiment(5))
    stranger.send(beside, said(3), said(4))
    stranger.until(lambda: stranger.numbers(replied) == [3, 4])


def test_what_nobody_has_is_sought_once(stranger, tmp_path, monkeypatch):
    """A recording is not read again with each experiment that comes; the others are answered."""
    sought: list[tuple[int, float | None]] = []

    def lost(found: Lookup, *about: float | None) -> None:
        sought.append(about)
        raise RecordingError(tmp_path, f"experiment {about[0]}", "none")

    monkeypatch.setattr(Lookup, "sent", lost)
    with BagWriter(tmp_path / "run", "rotor") as writer:
        writer.write("experiment", experiment(9), 1e9)
    stranger.start(DetectorNode, bag=str(tmp_path / "run"))
    stranger.listen("signal")
    stranger.send("prediction", prediction(3), prediction(5))
    stranger.send("experiment", *map(experiment, (4, 5, 6)))
    stranger.until(lambda: stranger.numbers("signal") == [5])
    assert [number for number, _ in sought] == [3]
