"""Child processes: started in groups of their own, watched, and ended for certain."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

POLL = 0.02  # s
CRASHED = 70  # exit code of a program that fell over its own error (EX_SOFTWARE of sysexits)
GRACE = 5.0  # s between INT, TERM and KILL
TAIL = 2000  # bytes of a dead child's output that are worth showing


@dataclass
class Child:
    """A process of the graph.

    Args:
        name: for messages ("twin", "machine_2").
        process: running or ended.
        log: file with its output.
        arguments: that it was started with.
    """

    name: str
    process: subprocess.Popen[bytes]
    log: Path
    arguments: tuple[str, ...] = ()

    @property
    def running(self) -> bool:
        """Whether the process has not ended yet."""
        return self.process.poll() is None

    @property
    def ended_well(self) -> bool:
        """Whether it has ended because it had nothing more to do, or was told to."""
        return self.process.poll() == 0

    @property
    def crashed(self) -> bool:
        """Whether it was killed, or fell over something that nobody had thought of."""
        code = self.process.poll()
        return code is not None and (code < 0 or code == CRASHED)

    def last_words(self) -> str:
        """The last line of its output that says something."""
        with self.log.open("rb") as file:
            file.seek(max(0, self.log.stat().st_size - TAIL))
            lines = file.read().decode(errors="replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), "no output")


class Supervisor:
    """Starts, watches and ends the processes of a graph.

    Args:
        folder: where their output goes.
        environment: of every child.
    """

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self.folder = folder
        self.environment = environment
        self.children: list[Child] = []
        #: Lets seconds pass; whoever listens to the graph goes on listening here.
        self.wait: Callable[[float], None] = time.sleep

    def start(self, name: str, *arguments: str) -> Child:
        """Start `python -m ldt_ros.process` with the arguments; it waits for `begin`."""
        child = self._started(name, *arguments)
        self.children.append(child)
        return child

    def restart(self, child: Child, *more: str) -> None:
        """Start an ended child once more, with more arguments than the first time."""
        again = self._started(child.name, *child.arguments, *more)
        child.process = again.process
        _begin(child)

    def _started(self, name: str, *arguments: str) -> Child:
        pid = str(os.getpid())
        log = self.folder / f"{name}.log"
        # -P: nothing in the user's folder may stand in for a module of ours.
        program = [sys.executable, "-P", "-m", "ldt_ros.process", "--parent", pid, "--hold"]
        with log.open("ab") as output:
            process = subprocess.Popen(
                [*program, *arguments],
                stdin=subprocess.PIPE,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=self.environment,
                # A group of its own: Ctrl-C reaches the parent alone, which ends things in order.
                start_new_session=True,
            )
        return Child(name, process, log, arguments)

    def begin(self) -> None:
        """Let the processes create their nodes."""
        for child in self.children:
            _begin(child)

    def dead(self) -> list[Child]:
        """Children that have ended."""
        return [c for c in self.children if not c.running]

    def stop(self, *children: Child, grace: float = GRACE) -> None:
        """End children, all at once: INT, then TERM, then KILL, each with its grace."""
        for child in children:
            if child.process.stdin is not None:
                child.process.stdin.close()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            for child in children:
                if child.running:
                    with contextlib.suppress(ProcessLookupError):
                        os.killpg(child.process.pid, number)
            deadline = time.monotonic() + grace
            while any(c.running for c in children) and time.monotonic() < deadline:
                self.wait(POLL)

    def stop_all(self) -> None:
        """End whatever still runs."""
        self.stop(*self.children)


def _begin(child: Child) -> None:
    assert child.process.stdin is not None
    with contextlib.suppress(BrokenPipeError):  # it is dead, which `dead` tells
        child.process.stdin.write(b"begin\n")
        child.process.stdin.close()
