"""The command line that a forked process shows to `ps` and to tools that look for it."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path

TITLE_BYTES = 1000  # of the longest command line to show


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
