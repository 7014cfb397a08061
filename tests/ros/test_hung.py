"""A node that does nothing any more, though its process lives, is taken for crashed."""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from disturbed import complaints, differences, nodes, ran, until, wait_for

from ldt_core.recording.bag import read_bag
from ldt_ros.graph import respawn
from ldt_ros.nodes.detector_node import DetectorNode
from ldt_ros.nodes.watchdog import alive
from ldt_ros.up import launch

LDT = str(Path(sys.executable).with_name("ldt"))
PATIENCE = 240  # s
RUN = ("--experiments", "12", "--seed", "3", "--model", "physics", "--start-time", "1e9")
UP = (*RUN, "--bag", "run")
#: Whose Python hangs in the middle of the sixth experiment, once.
HANGS = """
import time
from pathlib import Path
from ldt_core.detectors.threshold import Threshold

class Hangs(Threshold):
    def judge(self, residual, deviation):
        self.judged = getattr(self, "judged", 0) + 1
        if self.judged == 6 and not Path("hung").exists():
            Path("hung").touch()
            time.sleep(1e6)
        return super().judge(residual, deviation)
"""
#: A file of which the detector's process hangs at the import, once.
HANGS_AT_ONCE = """
import time
from pathlib import Path
from ldt_core.detectors.threshold import Threshold

if b"--node detector" in Path("/proc/self/cmdline").read_bytes() and not Path("hung").exists():
    Path("hung").touch()
    time.sleep(1e6)

class Hangs(Threshold):
    pass
"""


def test_a_node_that_hangs_at_its_start_is_killed_and_started_again(domain, tmp_path, monkeypatch):
    """All others waited for it for ever."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(respawn, "STARTUP", 4.0)
    (tmp_path / "own.py").write_text(HANGS_AT_ONCE)
    given = {"experiments": 2, "model": "physics", "detector": "own.py:Hangs", "bag": "run"}
    given["hung_after"] = 6  # the default is waited for otherwise, however soon a start is over
    begin = time.monotonic()
    (run,) = launch(given, stopped=lambda: time.monotonic() - begin > PATIENCE)
    assert run.summary.experiments == 2
    assert "detector hung once, was killed and started again" in run.summary.notes


def test_a_hung_node_is_killed_and_started_again(domain, programs, tmp_path):
    """Whether its Python hangs or its process is stopped: the same records, to the last bit."""
    (tmp_path / "own.py").write_text(HANGS)
    run = (*RUN, "--detector", "own.py:Hangs")
    (tmp_path / "hung").touch()
    ran(tmp_path, "run", *run, "--bag", "calm")
    (tmp_path / "hung").unlink()
    process = programs.start(
        [LDT, "up", *run, "--hung-after", "6", "--rate", "40", "--bag", "run", "--json"],
        cwd=tmp_path,
        text=True,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    wait_for(tmp_path / "run", 1)
    nodes(process.pid)["adaptor"].send_signal(signal.SIGSTOP)
    output, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, complaints(errors)) == (0, "")
    (told,) = json.loads(output)["runs"]
    hung = {f"{role} hung once, was killed and started again" for role in ("adaptor", "detector")}
    assert set(told["notes"]) >= hung
    assert differences(tmp_path / "calm", tmp_path / "run") == {}


@pytest.mark.parametrize("at", ["file", "@ldt"])
def test_a_node_that_works_tells_systemd_so(stranger, tmp_path, monkeypatch, at):
    """With each statement of its health; a watchdog that nobody serves is no trouble."""
    address = str(tmp_path / "notify") if at == "file" else f"@ldt{tmp_path}"
    monkeypatch.setenv("NOTIFY_SOCKET", address)
    alive()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(address.replace("@", "\0"))
        systemd.setblocking(False)
        stranger.start(DetectorNode)
        told: list[bytes] = []

        def told_twice() -> bool:
            with contextlib.suppress(BlockingIOError):
                told.append(systemd.recv(100))
            return len(told) > 1

        stranger.until(told_twice, "the second sign of life")
        assert set(told) == {b"WATCHDOG=1"}


def test_a_node_ends_although_the_middleware_does_not(domain, tmp_path, monkeypatch):
    """Fast DDS waited for itself for ever in two of 400 ends, of several nodes at one moment."""
    monkeypatch.chdir(tmp_path)
    program = """
import ctypes
from rclpy.node import Node
from ldt_ros.graph import environment, process
environment.LONGEST_END = 1.0
Node.destroy_node = lambda self: ctypes.PyDLL(None).sleep(1000)  # with Python's lock
process.leave(process.main([], "recorder"))
"""
    node = subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.PIPE, text=True)
    recordings = tmp_path / "ldt_recordings"
    until(lambda: [*recordings.glob("*/*.mcap")], lambda: "no recording")
    time.sleep(0.5)  # it spins
    node.send_signal(signal.SIGINT)
    assert "Timeout (0:00:01)!" in node.communicate(timeout=20)[1]
    assert node.returncode == 1
    (recording,) = recordings.iterdir()
    assert read_bag(recording).notes == []  # it has been finished before


@pytest.mark.parametrize("command", ["watch", "serve", "up"])
def test_a_command_ends_although_the_middleware_does_not(command, domain, tmp_path):
    """`ldt watch`, `ldt serve` and `ldt up` waited for it, deaf to Ctrl-C."""
    program = f"""
import ctypes, sys
from rclpy.node import Node
from ldt_core.cli import main
from ldt_ros.graph import environment
environment.LONGEST_END = 1.0
Node.destroy_node = lambda self: ctypes.PyDLL(None).sleep(1000)  # with Python's lock
sys.argv = {["ldt", command, *(UP if command == "up" else ("--port", "0"))]!r}
main()
"""
    told = tmp_path / "told"
    with told.open("w") as out:
        process = subprocess.Popen([sys.executable, "-c", program], cwd=tmp_path, stdout=out)
    if command != "up":
        until(lambda: "http" in told.read_text() or "ws:" in told.read_text(), told.read_text)
        time.sleep(1)
        process.send_signal(signal.SIGINT)
    try:
        assert process.wait(60) == 1
    finally:
        process.kill()
    if command == "up":  # which had recorded everything
        assert read_bag(tmp_path / "run").notes == []
