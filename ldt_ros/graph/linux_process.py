"""What Linux knows of a process and Python's library lacks: its parent, its command line."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

TITLE_BYTES = 1000  # of the longest command line to show
_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
_PR_GET_CHILD_SUBREAPER = 37


def end_with(parent: int, number: signal.Signals) -> bool:
    """Have this process sent a signal when its parent ends; False if it has ended already."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number)
    return os.getppid() == parent


@contextlib.contextmanager
def adopting() -> Iterator[None]:
    """Have descendants whose parents end within the context become children of this process."""
    prctl = ctypes.CDLL(None).prctl
    before = ctypes.c_int()
    prctl(_PR_GET_CHILD_SUBREAPER, ctypes.byref(before))
    prctl(_PR_SET_CHILD_SUBREAPER, 1)
    try:
        yield
    finally:
        prctl(_PR_SET_CHILD_SUBREAPER, before.value)


def entitle(*arguments: str) -> None:
    """Show these arguments as this process's command line, within the room that it has.

    `setproctitle` would write over the environment as well, by which tests and tools know whose a
    process is.
    """
    # Fields 48 and 49 of proc(5), of which the third is the first after the command's name.
    fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
    begin, end = int(fields[45]), int(fields[46])
    line = " ".join((sys.executable, *arguments)).encode()[: end - begin - 2]
    # A last byte other than 0 tells the kernel that this is one text, ended by the first 0.
    ctypes.memmove(begin, line.ljust(end - begin - 1, b"\0") + b" ", end - begin)
