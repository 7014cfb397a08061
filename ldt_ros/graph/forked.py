"""Processes that a fork server makes, and the server as who asks it sees it."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ldt_core.base.errors import LdtError
from ldt_ros.graph.fork_server import ROOM

PATIENCE = 60.0  # s; the server imports everything before it answers for the first time
ANSWER = 4096  # bytes


class Forked:
    """A child of this process that another one has forked; as `subprocess.Popen` has it.

    Args:
        pid: process id.

    Attributes:
        returncode: exit code, minus the signal's number if one ended it, None while it runs.
    """

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None

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


class ForkServer:
    """Starts `ldt_ros.graph.fork_server`, whose forks become children of this process.

    That is so within `ldt_ros.graph.parentage.adopting`.

    Args:
        log: file that its output goes to.
        environment: of the server, and so of what it forks.
        settings: what it prepares for: `machine` and `model`.
    """

    def __init__(
        self, log: Path, environment: Mapping[str, str], settings: Mapping[str, Any]
    ) -> None:
        self.log = log
        self._channel, end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._channel.settimeout(PATIENCE)
        # -P: nothing in the user's folder may stand in for a module of ours.
        program = [sys.executable, "-P", "-m", "ldt_ros.graph.fork_server"]
        # The last one is room for the command lines that the forks show.
        arguments = [str(end.fileno()), str(os.getpid()), " " * ROOM]
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

    def fork(self, log: Path, arguments: Sequence[str]) -> Forked:
        """A process of its own group that does what `ldt_ros.graph.process` does.

        Args:
            log: file that its output is added to.
            arguments: of `ldt_ros.graph.process`.

        Raises:
            ConnectionError: the server has ended.
            LdtError: the server cannot fork, or does not answer.
        """
        with log.open("ab") as output:
            try:
                request = json.dumps(list(arguments)).encode()
                socket.send_fds(self._channel, [request], [output.fileno()])
                answer = self._channel.recv(ANSWER).decode()
            except TimeoutError as error:
                raise LdtError(f"no process of a node started within {PATIENCE:g} s") from error
        if not answer:
            raise ConnectionResetError("the fork server has ended")
        if not answer.isdecimal():
            raise LdtError(f"no process of a node can be started: {answer}")
        return Forked(int(answer))

    def end(self) -> None:
        """End the server; what it has forked goes on."""
        self._channel.close()
        self._process.kill()
        self._process.wait()
