"""Child processes: forked in groups of their own, watched, and ended for certain."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from ldt_core.base.errors import LdtError
from ldt_ros.graph.linux_process import TITLE_BYTES, adopting
from ldt_ros.graph.process import CRASHED

POLL = 0.02  # s between two looks whether children have ended
MAX_SERVER_RESTARTS = 5  # fork servers killed one after the other before one has forked
GRACE = 5.0  # s between INT, TERM and KILL
PRELOADED = ("machine", "model", "detector")  # settings whose code the fork server loads
TAIL = 2000  # bytes at the end of a process's output that may hold its last line
FORK_TIMEOUT = 60.0  # s; the server imports everything before its first answer
ANSWER = 4096  # bytes of the server's answer at most


class NodeFailure(LdtError):
    """Processes of nodes failed; the folder with their output stays, and the sentence names it."""

    def __init__(self, reason: str, folder: Path) -> None:
        super().__init__(f"{reason} (all output: {folder})")


@dataclass
class Child:
    """A process of the graph, a child of this one that the fork server has made.

    Args:
        name: for messages ("twin", "machine_2").
        pid: process id.
        log: file with its output.
        arguments: that it was started with.

    Attributes:
        returncode: exit code, minus the signal's number if one ended it, None while it runs.
        told: the signal by which it was last told to end, 0 if none.
    """

    name: str
    pid: int
    log: Path
    arguments: tuple[str, ...] = ()
    returncode: int | None = None
    told: int = 0

    def poll(self) -> int | None:
        """The exit code, None while it runs."""
        if self.returncode is None:
            try:
                pid, status = os.waitpid(self.pid, os.WNOHANG)
            except ChildProcessError:  # somebody else has waited for it
                self.returncode = 0
            else:
                self.returncode = os.waitstatus_to_exitcode(status) if pid else None
        return self.returncode

    @property
    def running(self) -> bool:
        """Whether the process has not ended yet."""
        return self.poll() is None

    @property
    def ended_well(self) -> bool:
        """Whether it has ended because it had nothing more to do, or was told to."""
        return self.poll() == 0

    @property
    def crashed(self) -> bool:
        """Whether it was killed, or ended by an error that nobody had thought of."""
        code = self.poll()
        return code is not None and (code < 0 or code == CRASHED)

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the process and those that it has started, if any is left.

        One that somebody has stopped goes on: it would heed none before.
        """
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, number)
            os.killpg(self.pid, signal.SIGCONT)


def last_line(log: Path) -> str:
    """The last line of a process's output that may be the reason of its end."""
    try:
        with log.open("rb") as file:
            file.seek(max(0, log.stat().st_size - TAIL))
            lines = file.read().decode(errors="replace").split("\n")
    except FileNotFoundError:
        return "its output was deleted"
    told = (line.strip() for line in reversed(lines))
    return next((line for line in told if line and not line.startswith("[INFO]")), "no output")


class ForkServer:
    """Starts `ldt_ros.graph.fork_server`, whose forks become children of this process.

    That is so within `ldt_ros.graph.linux_process.adopting`.
    """

    def __init__(
        self, log: Path, environment: Mapping[str, str], settings: Mapping[str, Any]
    ) -> None:
        self.log = log
        self._channel, end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._channel.settimeout(FORK_TIMEOUT)
        # -P: nothing in the user's folder may stand in for a module of ours.
        program = [sys.executable, "-P", "-m", "ldt_ros.graph.fork_server"]
        # The last argument is room for the command lines that the forks show.
        arguments = [str(end.fileno()), str(os.getpid()), " " * TITLE_BYTES]
        with end, log.open("ab") as output:
            self._process = subprocess.Popen(
                [*program, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=environment,
                pass_fds=[end.fileno()],
                # A group of its own: Ctrl-C reaches the parent alone, which ends things in order.
                start_new_session=True,
            )
        self._channel.send(json.dumps(dict(settings)).encode())

    def fork(self, log: Path, arguments: Sequence[str]) -> int:
        """Start a process in a group of its own that does what `ldt_ros.graph.process` does.

        Returns:
            Its process id.

        Raises:
            ConnectionError: the server has ended.
            LdtError: the server cannot fork, or does not answer.
        """
        log.parent.mkdir(mode=0o700, exist_ok=True)  # a cleaner of /tmp takes what is old
        with log.open("ab") as output:
            try:
                request = json.dumps(list(arguments)).encode()
                socket.send_fds(self._channel, [request], [output.fileno()])
                answer = self._channel.recv(ANSWER).decode()
            except TimeoutError as error:
                raise LdtError(f"no process of a node started within {FORK_TIMEOUT:g} s") from error
        if not answer:
            raise ConnectionResetError("the fork server has ended")
        if not answer.isdecimal():
            raise LdtError(f"no process of a node can be started: {answer}")
        return int(answer)

    def end(self) -> None:
        """End the server; what it has forked goes on."""
        self._channel.close()
        self._process.kill()
        self._process.wait()


class Supervisor:
    """Starts, watches and ends the processes of a graph; a context, at whose end none is left."""

    def __init__(
        self, folder: Path, environment: Mapping[str, str], settings: Mapping[str, Any]
    ) -> None:
        self.folder = folder
        self._environment = environment
        self._settings = {name: settings[name] for name in PRELOADED}
        self.children: list[Child] = []
        #: Lets seconds pass; whoever listens to the graph goes on listening here.
        self.wait: Callable[[float], None] = time.sleep
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        self._stack.enter_context(adopting())
        # The children load what they need beside whatever is done until they are started.
        self._server = self._new_server()
        self._stack.callback(lambda: self._server.end())
        self._stack.callback(self.stop_all)
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _new_server(self) -> ForkServer:
        return ForkServer(self.folder / "fork_server.log", self._environment, self._settings)

    def start(self, name: str, *arguments: str) -> Child:
        """Start `ldt_ros.graph.process` with the arguments.

        Raises:
            LdtError: no process could be started.
        """
        log = self.folder / f"{name}.log"
        child = Child(name, self._fork(log, arguments), log, arguments)
        self.children.append(child)
        return child

    def restart(self, child: Child) -> None:
        """Start an ended child once more."""
        child.pid, child.returncode = self._fork(child.log, child.arguments), None
        child.told = 0

    def _fork(self, log: Path, arguments: tuple[str, ...]) -> int:
        for _ in range(MAX_SERVER_RESTARTS):
            try:
                return self._server.fork(log, arguments)
            except ConnectionError:  # it was killed; the nodes do not need it to go on
                told = last_line(self._server.log)
                self._server.end()
                self._server = self._new_server()
        raise LdtError(f"no process of a node can be started: {told}")

    def stop(self, *children: Child, grace: float = GRACE) -> None:
        """End children, all at once: INT, then TERM, then KILL, each with its grace."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            for child in children:
                if child.running:
                    child.send(number)
                    child.told = number
            deadline = time.monotonic() + grace
            while any(c.running for c in children) and time.monotonic() < deadline:
                self.wait(POLL)

    def stop_all(self) -> None:
        """End whatever still runs."""
        self.stop(*self.children)
