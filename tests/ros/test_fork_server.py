"""Where the processes of the nodes come from: one that has imported everything, and forks."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time

import psutil
import pytest

from ldt_core.base.errors import LdtError

pytest.importorskip("rclpy")

from ldt_ros.graph.linux_process import adopting
from ldt_ros.graph.supervisor import Supervisor

SETTINGS = {"machine": "rotor", "model": "physics", "detector": "threshold"}
TWIN = ("--node", "twin", "--ros-args", "-p", "model:=physics")
PATIENCE = 60  # s


@pytest.fixture
def others():
    """Children of this process that other tests have left, a pool of joblib's for one."""
    return set(psutil.Process().children())


def ended(child):
    """Wait for a child's end."""
    deadline = time.monotonic() + PATIENCE
    while child.running:
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_what_is_forked_is_a_process_of_its_own_and_needs_the_server_no_more(
    environment, monkeypatch, tmp_path, others
):
    """Recognised by its command line, this one's child, in its own session; the server may die."""
    (tmp_path / "json.py").write_text("raise RuntimeError('not the one that was meant')")
    monkeypatch.chdir(tmp_path)
    with Supervisor(tmp_path, environment, SETTINGS) as supervisor:
        twin = supervisor.start("twin", *TWIN)
        (server,) = (c for c in set(psutil.Process().children()) - others if c.pid != twin.pid)
        process = psutil.Process(twin.pid)
        line = process.cmdline()
        assert line[line.index("ldt_ros.graph.process") :] == ["ldt_ros.graph.process", *TWIN]
        assert "ldt_ros.graph.fork_server" in server.cmdline()
        assert process.environ()["ROS_DOMAIN_ID"] == environment["ROS_DOMAIN_ID"]
        assert process.ppid() == os.getpid()
        assert os.getsid(process.pid) == process.pid
        server.kill()
        server.wait(PATIENCE)
        process.kill()
        ended(twin)
        supervisor.restart(twin)  # by a server that takes the other's place
        again = psutil.Process(twin.pid)
        assert again.pid != process.pid
        assert again.cmdline() == line
        # One that was killed has that for its exit code; one that is told to stop ends well.
        again.send_signal(signal.SIGSTOP)
        other = supervisor.start("other", *TWIN)
        again.kill()
        ended(twin)
        assert (twin.returncode, twin.crashed) == (-signal.SIGKILL, True)
        supervisor.stop(other)
        assert (other.returncode, other.crashed) == (0, False)
    assert set(psutil.Process().children()) <= others


def test_servers_that_are_killed_one_after_the_other_do_not_end_the_run(
    environment, tmp_path, others
):
    """Each of them while it is still importing, which takes seconds on a busy machine."""
    seen: set[int] = set()

    def kill() -> None:
        while len(seen) < 3:
            for child in set(psutil.Process().children()) - others:
                if child.pid not in seen:
                    seen.add(child.pid)
                    child.kill()
            time.sleep(0.05)

    with Supervisor(tmp_path, environment, SETTINGS) as supervisor:
        killer = threading.Thread(target=kill)
        killer.start()
        twin = supervisor.start("twin", *TWIN)
        killer.join(PATIENCE)
        assert len(seen) == 3
        assert twin.pid not in seen
        assert twin.running


def test_a_process_that_is_stopped_as_soon_as_it_is_known_ends_well(environment, tmp_path):
    """Before it has begun to listen to signals: told to stop, it has not crashed."""
    with Supervisor(tmp_path, environment, SETTINGS) as supervisor:
        for number in range(5):
            child = supervisor.start(f"twin_{number}", *TWIN)
            supervisor.stop(child)
            assert child.ended_well, child.last_line()


def test_a_server_that_cannot_load_is_told_in_a_sentence(environment, tmp_path, others):
    """With the last that it said; and nothing is left of it."""
    (tmp_path / "numpy.py").write_text("raise ImportError('a broken library')")
    path = os.pathsep.join((str(tmp_path), environment.get("PYTHONPATH", "")))
    broken = {**environment, "PYTHONPATH": path}
    sentence = "no process of a node can be started: ImportError: a broken library"
    with (
        pytest.raises(LdtError, match=sentence),
        Supervisor(tmp_path, broken, SETTINGS) as supervisor,
    ):
        supervisor.start("twin", *TWIN)
    assert set(psutil.Process().children()) <= others


def test_orphans_are_adopted_within_the_context_alone():
    """By the process that asked; afterwards they go where they went before."""

    def orphan() -> psutil.Process:
        script = "sleep 60 > /dev/null & echo $!"
        return psutil.Process(int(subprocess.check_output(["sh", "-c", script])))

    with adopting():
        adopted = orphan()
        assert adopted.ppid() == os.getpid()
        adopted.kill()
        assert adopted.wait(PATIENCE) == -signal.SIGKILL
    other = orphan()
    assert other.ppid() != os.getpid()
    other.kill()
