"""The recorder in a process of its own: what it keeps when it ends, and when the disk is full."""

from __future__ import annotations

import resource
import signal
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from ldt_core.recording.bag import read_bag
from ldt_core.recording.node_status import (
    INTERRUPTIONS,
    LAST_INTERRUPTION,
    REJECTED,
    WRONG_RECORDING,
    NodeStatus,
)

rclpy = pytest.importorskip("rclpy")


from stranger import LENGTH, PERIOD, experiment  # noqa: E402

from ldt_ros.nodes.interfaces import to_message  # noqa: E402
from ldt_ros.nodes.recorder_node import RecorderNode  # noqa: E402

LIMIT = 200_000  # bytes; the disk is full then


@pytest.fixture
def recorder(programs, tmp_path):
    """Starts a recorder in a process of its own."""

    def start(*more: str, before=None) -> subprocess.Popen[str]:
        ros = ["--ros-args", "-p", f"bag:={tmp_path / 'bag'}", *more]
        return programs.start(
            [sys.executable, "-m", "ldt_ros.graph.process", "--node", "recorder", *ros],
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            preexec_fn=before,
        )

    return start


def noise(number: int, length: int = LENGTH):
    """An experiment that does not compress."""
    random = np.random.default_rng(number)
    base = experiment(number, length=length)
    return type(base)(number, base.start, PERIOD, base.voltage, random.normal(size=length))


def test_a_burst_right_before_the_end_is_recorded_whole(stranger, recorder, tmp_path):
    """The recorder drains what is under way when it is told to stop."""
    process = recorder()
    publisher = stranger.publisher("experiment")
    process.send_signal(signal.SIGSTOP)  # whatever comes now lies in wait when it goes on
    for number in range(1, 81):
        publisher.publish(to_message(noise(number, 200)))
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGCONT)
    # Whoever sends stays until the recorder has ended, as in the graph.
    stranger.until(lambda: process.poll() is not None, "end of the recorder")
    assert (process.returncode, process.communicate()[0]) == (0, "")
    bag = read_bag(tmp_path / "bag")
    assert bag.notes == []
    assert [e.number for e in bag.experiments()] == list(range(1, 81))


def test_a_full_disk_is_counted_and_what_came_meanwhile_is_recorded_once_there_is_room(
    stranger, recorder, tmp_path
):
    """One line in the log, a count in /diagnostics, exit code 0: the twin does not depend on it."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT, resource.RLIM_INFINITY))

    process = recorder("-p", "graph:=[plant]", before=limit)
    stranger.listen("/diagnostics")
    publisher = stranger.publisher("experiment")
    sent = 0

    def full() -> dict[str, str]:
        nonlocal sent
        sent += 1
        publisher.publish(to_message(noise(sent, 2000)))
        stranger.spin(0.05)
        told = stranger.health("recorder")
        return told if WRONG_RECORDING in told else {}

    told = stranger.until(full, "a recorder that cannot write")
    assert told["level"] == 1
    assert "recording stopped after" in told[LAST_INTERRUPTION]
    assert told["message"] == told[WRONG_RECORDING]
    assert not [key for key in told if key.startswith(REJECTED)]  # nobody sent anything wrong
    assert 5 < sent < 100
    kept = [e.number for e in read_bag(tmp_path / "bag").experiments()]
    assert kept == list(range(1, len(kept) + 1))
    assert 0 < len(kept) < sent
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)

    def complete() -> bool:
        stranger.spin(0.2)
        return len(list(read_bag(tmp_path / "bag").experiments())) == sent

    stranger.until(complete, "what was missed")

    def well() -> dict[str, str]:  # what it told before it went on may have been heard last
        told = stranger.health("recorder")
        return told if told["level"] == 0 else {}

    assert stranger.until(well, "a recorder that writes")[INTERRUPTIONS] == "1"
    process.send_signal(signal.SIGINT)
    stranger.until(lambda: process.poll() is not None, "end of the recorder")
    output = process.communicate()[0]
    assert process.returncode == 0, output
    assert output.count("recording stopped after") == 1, output
    assert output.count("recording goes on in a new file") == 1, output
    assert "Traceback" not in output
    bag = read_bag(tmp_path / "bag")
    assert sorted(e.number for e in bag.experiments()) == list(range(1, sent + 1))
    assert bag.notes == []


def test_a_disk_that_is_nearly_full_is_told_before_it_is(stranger, tmp_path, monkeypatch, monitor):
    """By the recorder, and once by the run, however little is left later."""
    free = SimpleNamespace(free=500 * 2**20)
    monkeypatch.setattr("ldt_ros.nodes.recorder_node.shutil.disk_usage", lambda place: free)
    stranger.listen("/diagnostics")
    node = stranger.start(RecorderNode, bag=str(tmp_path / "bag"))
    words = f"only 500 MiB are free where {tmp_path / 'bag'} is: make room"
    stranger.until(lambda: stranger.health("recorder").get("message") == words)
    assert stranger.health("recorder")["level"] == 1
    ear, _ = monitor
    told: list[str] = []
    ear.on_warning = lambda role, words: told.append(f"{role}: {words}")
    for _ in range(2):
        ear.hear(NodeStatus("recorder", words, {k: str(v) for k, v in node.health().items()}))
        free.free -= 2**20
    assert told == [f"recorder: {words}"]
    free.free = 2**31
    assert not node.complaint()


def test_a_run_says_at_once_that_nothing_is_recorded_any_more(monitor, monkeypatch):
    """Once, however often the disk has room for a message; and when it goes on for good."""
    ear, _ = monitor
    told: list[str] = []
    ear.on_warning = lambda role, words: told.append(f"{role}: {words}")
    full = NodeStatus("recorder", "", {WRONG_RECORDING: "the disk is full"})
    for status in (full, NodeStatus("recorder", "running", {}), full):
        ear.hear(status)
    assert told == ["recorder: the disk is full"]
    monkeypatch.setattr("ldt_ros.graph.monitor.WELL_AGAIN", 0.0)
    ear.hear(NodeStatus("recorder", "running", {}))
    assert told[1:] == ["recorder: the recording goes on, in a new file"]


def test_a_run_says_at_once_what_its_nodes_reject(monitor):
    """Once a kind: a machine whose speeds are no numbers went on for days without a line."""
    ear, _ = monitor
    told: list[str] = []
    ear.on_warning = lambda role, words: told.append(f"{role}: {words}")
    for count in "12":
        values = {"rejected speed: RecordingError": count, "last rejection": "speed: got nan"}
        ear.hear(NodeStatus("segmenter", "", values))
    assert told == ["segmenter: rejected a message on speed: got nan"]
