"""Listeners that stall, and a medium slower than the graph: nothing else slows down or loses."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from disturbed import complaints, differences, ran
from stranger import experiment

from ldt_core.recording.bag import read_bag
from ldt_ros.nodes import recorder_node
from ldt_ros.nodes.recorder_node import Backlog

HERE = Path(__file__).parent
LDT = str(Path(sys.executable).with_name("ldt"))
PATIENCE = 240  # s
RUN = ("--experiments", "30", "--seed", "3", "--model", "physics", "--start-time", "1e9")


def test_a_listener_that_is_stopped_holds_nobody_up(domain, programs, tmp_path):
    """It asks for everything, reliably: the same records, and nobody waited in vain."""
    ran(tmp_path, "run", *RUN, "--bag", "calm")
    told = subprocess.PIPE
    ear = programs.start([sys.executable, str(HERE / "stalled.py")], stdout=told, text=True)
    assert ear.stdout.readline().strip() == "there"
    graph = [LDT, "up", *RUN, "--bag", "run", "--json"]
    run = programs.start(graph, cwd=tmp_path, text=True, stdout=told, stderr=told)
    assert ear.stdout.readline().strip() == "met"
    ear.send_signal(signal.SIGSTOP)
    output, errors = run.communicate(timeout=PATIENCE)
    assert (run.returncode, complaints(errors)) == (0, "")
    assert json.loads(output)["runs"][0]["notes"] == []
    assert differences(tmp_path / "calm", tmp_path / "run") == {}


def test_a_backlog_is_bounded_in_count_and_bytes_and_counts_what_it_leaves_out():
    """One item is at work; one that is too large alone waits all the same if none else does."""
    begun, gate, done = threading.Event(), threading.Event(), []

    def work(item: int) -> None:
        begun.set()
        gate.wait(20)
        done.append(item)

    backlog = Backlog(work, messages=3, most_bytes=100)
    backlog.put("small", 1, 0)
    assert begun.wait(20)
    for item, (kind, size) in enumerate(
        [("large", 500), ("small", 1), ("large", 500), ("small", 1)], start=1
    ):
        backlog.put(kind, size, item)
    assert backlog.dropped == {"small": 2, "large": 1}
    assert len(backlog) == 2
    gate.set()
    backlog.close(20)
    assert done == [0, 1]
    backlog.put("late", 1, 9)
    assert backlog.dropped["late"] == 1


def test_nobody_waits_for_ever_for_a_medium_that_is_stuck():
    """The end gives up on what waits once nothing is done any more."""
    stuck = threading.Event()
    backlog = Backlog(lambda: stuck.wait(20) and None)
    backlog.put("any", 1)
    backlog.put("any", 1)
    backlog.close(0.1)
    assert len(backlog) == 2
    stuck.set()


def test_a_recorder_slower_than_the_graph_counts_what_it_leaves_out(
    stranger, tmp_path, monkeypatch
):
    """WARN in /diagnostics with the number; what it took is written in order, the rest missing."""
    monkeypatch.setattr(
        recorder_node, "Backlog", lambda work: Backlog(work, messages=10, most_bytes=10**9)
    )
    node = stranger.start(recorder_node.RecorderNode, bag=str(tmp_path / "bag"))
    gate, write = threading.Event(), node.writer.write_raw
    node.writer.write_raw = lambda *message: gate.wait(30) and write(*message)
    stranger.listen("/diagnostics")
    for number in range(1, 31):
        stranger.send("experiment", experiment(number))
        stranger.spin(0.01)
    told = stranger.until(
        lambda: int((h := stranger.health("recorder")).get("dropped experiment", 0)) >= 19 and h
    )
    assert told["level"] == 1
    assert told["message"].endswith("messages not recorded: the medium is too slow")
    gate.set()
    stranger.until(lambda: not len(node.backlog))
    stranger.send("experiment", experiment(31))
    stranger.until(lambda: 31 in node.writer.recorded("/experiment"))
    stranger.node.destroy_publisher(stranger.publishers["experiment"])
    node.close()
    numbers = [e.number for e in read_bag(tmp_path / "bag").experiments()]
    assert numbers == [*range(1, len(numbers)), 31]
    assert len(numbers) + node.backlog.dropped["experiment"] == 31
