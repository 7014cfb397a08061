"""What a failing test has started is gone when the next one begins."""

from __future__ import annotations

import signal
import subprocess
import sys

import psutil
import pytest
from programs import Programs

STUBBORN = """
import signal, subprocess, sys, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
signal.signal(signal.SIGINT, signal.SIG_IGN)
if sys.argv[1:]:
    child = subprocess.Popen([sys.executable, *sys.argv[1:]], start_new_session=True)
    print(child.pid, flush=True)
time.sleep(600)
"""


def runs(pid: int) -> bool:
    """Whether a process does anything; an orphan that was killed waits for init to take note."""
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


@pytest.mark.parametrize("parent", ["alive", "gone"])
def test_nothing_outlives_a_failing_test(parent):
    """Not even a child in a session of its own that listens to no signal, nor as an orphan."""

    def fail() -> None:
        with Programs() as programs:
            command = [sys.executable, "-c", STUBBORN, "-c", STUBBORN]
            process = programs.start(command, stdout=subprocess.PIPE, text=True)
            pids.extend([process.pid, int(process.stdout.readline())])
            assert all(map(psutil.pid_exists, pids))
            if parent == "gone":
                process.send_signal(signal.SIGKILL)
                process.wait()
            pytest.fail("as a test does that has had enough")

    pids: list[int] = []
    with pytest.raises(pytest.fail.Exception):
        fail()
    assert len(pids) == 2
    assert not any(map(runs, pids))


def test_what_ends_by_itself_is_told_with_its_words():
    """And time that runs out is no reason to go on."""
    with Programs() as programs:
        code = "import sys; print('out', flush=True); sys.exit('err')"
        assert programs.run([sys.executable, "-c", code], timeout=60) == (1, "out\nerr\n")
        with pytest.raises(subprocess.TimeoutExpired):
            programs.run([sys.executable, "-c", STUBBORN], timeout=0.2)
