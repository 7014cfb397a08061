"""Child processes: started in groups of their own, watched, and ended for certain."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from ldt_core.base.errors import LdtError
from ldt_ros.graph.forked import Forked, ForkServer
from ldt_ros.graph.parentage import adopting

POLL = 0.02  # s
CRASHED = 70  # exit code of a program that fell over its own error (EX_SOFTWARE of sysexits)
SERVERS = 5  # fork servers that may be killed one after the other, before any has forked
GRACE = 5.0  # s between INT, TERM and KILL
PARTS = ("machine", "model", "detector")  # whose code is loaded before the nodes begin
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
    process: Forked
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
        return last_words(self.log)


def last_words(log: Path) -> str:
    """The last line of a process's output that says something."""
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - TAIL))
        lines = file.read().decode(errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "no output")


class Supervisor:
    """Starts, watches and ends the processes of a graph; a context, at whose end none is left.

    Args:
        folder: where their output goes.
        environment: of every child.
        settings: of the graph, `PARTS` among them.
    """

    def __init__(
        self, folder: Path, environment: Mapping[str, str], settings: Mapping[str, Any]
    ) -> None:
        self.folder = folder
        self._environment = environment
        self._settings = {name: settings[name] for name in PARTS}
        self.children: list[Child] = []
        #: Lets seconds pass; whoever listens to the graph goes on listening here.
        self.wait: Callable[[float], None] = time.sleep
        self._server: ForkServer | None = None
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        self._stack.enter_context(adopting())
        self._stack.callback(self._end_server)
        self._stack.callback(self.stop_all)
        self.prepare()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def prepare(self) -> None:
        """Begin to load what the children need, beside whatever is done meanwhile."""
        self._server = ForkServer(
            self.folder / "fork_server.log", self._environment, self._settings
        )

    def start(self, name: str, *arguments: str) -> Child:
        """Start `ldt_ros.graph.process` with the arguments.

        Raises:
            LdtError: no process could be started.
        """
        child = self._started(name, *arguments)
        self.children.append(child)
        return child

    def restart(self, child: Child) -> None:
        """Start an ended child once more."""
        again = self._started(child.name, *child.arguments)
        child.process = again.process

    def _started(self, name: str, *arguments: str) -> Child:
        log = self.folder / f"{name}.log"
        return Child(name, self._forked(log, arguments), log, arguments)

    def _forked(self, log: Path, arguments: tuple[str, ...]) -> Forked:
        assert self._server is not None
        for _ in range(SERVERS):
            try:
                return self._server.fork(log, arguments)
            except ConnectionError:  # it was killed; the nodes do not need it to go on
                words = last_words(self._server.log)
                self._end_server()
                self.prepare()
        raise LdtError(f"no process of a node can be started: {words}")

    def _end_server(self) -> None:
        if self._server is not None:
            self._server.end()

    def dead(self) -> list[Child]:
        """Children that have ended."""
        return [c for c in self.children if not c.running]

    def kill(self, child: Child) -> None:
        """End a child that does nothing any more; it is found dead a moment later."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(child.process.pid, signal.SIGKILL)

    def stop(self, *children: Child, grace: float = GRACE) -> None:
        """End children, all at once: INT, then TERM, then KILL, each with its grace."""
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
