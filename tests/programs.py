"""Programs that a test starts: whatever becomes of the test, none of them outlives it."""

from __future__ import annotations

import os
import subprocess
import sys
import time
import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

import psutil

#: `ldt` of this Python and this checkout, whatever is installed.
LDT = (sys.executable, "-c", "from ldt_core.cli import main; main()")
MARK = "LDT_TEST_PROGRAM"
PATIENCE = 20  # s for what was killed to be gone
MOMENT = 0.01  # s between looks at a process that only just begins its program


class Programs:
    """A context, at whose end all that was started in it is killed.

    Also what these programs have started, in whichever session and whoever its parent is now: they
    know each other by a mark in their environment.
    """

    def __init__(self) -> None:
        self._mark = uuid.uuid4().hex
        self._started: list[subprocess.Popen[Any]] = []

    def start(self, command: Sequence[str | Path], **options: Any) -> subprocess.Popen[Any]:
        """A program in a session of its own; options are those of `subprocess.Popen`."""
        options["env"] = {**(options.get("env") or os.environ), MARK: self._mark}
        process = subprocess.Popen(command, start_new_session=True, **options)
        self._started.append(process)
        return process

    def run(self, command: Sequence[str | Path], timeout: float, **options: Any) -> tuple[int, str]:
        """Exit code, and what was printed to either output, of a program that ends by itself.

        Raises:
            subprocess.TimeoutExpired: it does not within the time [s].
        """
        both = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        process = self.start(command, **both, **options)
        printed, _ = process.communicate(timeout=timeout)
        return process.returncode, printed

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        # What is killed may have started another in the meantime.
        while left := self._left():
            for process in left:
                process.kill()
            psutil.wait_procs(left, PATIENCE)
        for process in self._started:
            process.wait(PATIENCE)
            for pipe in (process.stdin, process.stdout, process.stderr):
                if pipe is not None:
                    pipe.close()

    def _left(self) -> list[psutil.Process]:
        found = []
        for process in psutil.process_iter():
            try:
                # Whoever started it may know of it before its arguments and environment are there.
                while process.exe() and not process.cmdline():
                    time.sleep(MOMENT)
                if process.environ().get(MARK) == self._mark:
                    found.append(process)
            except (psutil.Error, OSError):  # ended just now, or is somebody else's
                continue
        return found
