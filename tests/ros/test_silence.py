"""Who is taken for hung: a process that is silent while others speak."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")

from ldt_ros.graph import respawn
from ldt_ros.graph.respawn import Silence
from ldt_ros.nodes.statements import concerns

AFTER = 4.0  # s


@pytest.fixture
def clock(monkeypatch):
    """Time as it is told."""
    now = [0.0]
    monkeypatch.setattr(respawn.time, "monotonic", lambda: now[0])
    return now


def passed(clock, told: Silence, seconds: float, **tells: int) -> None:
    """Let time pass in which each process tells something so often a second."""
    for _ in range(int(seconds * 20)):
        clock[0] += 0.05
        told.look({name: int(clock[0] * often) for name, often in tells.items()})


def test_one_that_is_silent_while_others_speak_is_hung(clock):
    """After the time that it is given, not before."""
    told = Silence()
    passed(clock, told, 3.0, twin=1, plant=1, recorder=1)
    passed(clock, told, 3.5, twin=0, plant=1, recorder=1)
    assert not told.hung("twin", AFTER)
    passed(clock, told, 1.5, twin=0, plant=1, recorder=1)
    assert told.hung("twin", AFTER)
    assert not told.hung("plant", AFTER)
    told.forgive("twin")
    assert not told.hung("twin", AFTER)


def test_where_all_are_silent_it_is_the_machine(clock):
    """Of a busy machine none is killed, and of a stack that hangs as a whole one at last."""
    told = Silence()
    passed(clock, told, 3.0, twin=1, plant=1, recorder=1)
    passed(clock, told, 30.0, twin=0, plant=0, recorder=0)
    assert not any(told.hung(name, AFTER) for name in ("twin", "plant", "recorder"))
    passed(clock, told, 15.0, twin=0, plant=0, recorder=0)
    assert told.hung("twin", AFTER)


def test_what_this_process_slept_itself_counts_for_nobody(clock):
    """A laptop's lid, a debugger: silence of hours is none."""
    told = Silence()
    passed(clock, told, 3.0, twin=1, plant=1)
    clock[0] += 1e4
    told.look({"twin": 3, "plant": 3})
    assert not told.hung("twin", AFTER)


@pytest.mark.parametrize(
    ("data", "namespace", "expected"),
    [
        (b"\0machine_1/twin\0ready\0true", "/machine_1", True),
        (b"\0machine_1/twin\0ready\0true", "/machine_11", False),
        (b"\0machine_11/twin\0ready\0true", "/machine_1", False),
        (b"\0machine_2/twin\0ready\0true\0machine_1/twin", "/machine_1", True),
        (b"\0motor driver\0temperature\x0060", "/machine_1", True),
        (b"\0machine_1/twin\0ready\0true", "/", True),
    ],
)
def test_what_other_machines_twins_tell_is_not_read(data, namespace, expected):
    """Anything else is: a recording has what the machine's other parts tell."""
    assert concerns(data, namespace) is expected
