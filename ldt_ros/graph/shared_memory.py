"""Shared-memory files: none may be left that was not there before."""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from ldt_core.base.errors import BadInput

SHARED = Path("/dev/shm")
# The tracing library that rclpy is linked with makes its files whether or not anything is traced;
# Fast DDS makes its own where a profile allows shared memory, and leaves them when it is killed.
DDS = ("fastrtps_", "fastdds_", "sem.fastrtps_", "sem.fastdds_")
MAPPED = 16_384  # bytes that rclpy's tracing library maps there: two pages, with some room
OURS = ("lttng-ust-wait-", *DDS)


def require_room() -> None:
    """Refuse a full /dev/shm: what maps a page there that cannot be had is killed by SIGBUS.

    Where it does not exist or cannot be written to, nobody maps anything.

    Raises:
        BadInput: it is full.
    """
    try:
        with tempfile.TemporaryFile(dir=SHARED) as file:
            os.posix_fallocate(file.fileno(), 0, MAPPED)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            room = f"room for {MAPPED} bytes, which the ROS 2 libraries share"
            raise BadInput(str(SHARED), room, error.strerror) from None


@contextlib.contextmanager
def shared_memory_cleared() -> Iterator[None]:
    """Remove the middleware's shared-memory files made within the context by this user.

    A file that another live process has mapped stays.
    """
    before = middleware_files()
    try:
        yield
    finally:
        for name in middleware_files() - before - _mapped_by_others():
            with contextlib.suppress(OSError):
                (SHARED / name).unlink()


def leftovers() -> set[str]:
    """Names of Fast DDS' files of this user that no live process has mapped."""
    return {n for n in middleware_files() - _mapped_by_others() if n.startswith(DDS)}


def middleware_files() -> set[str]:
    """Names of the middleware's files of this user."""
    if not SHARED.is_dir():
        return set()
    own = set()
    for path in SHARED.iterdir():
        with contextlib.suppress(OSError):
            if path.name.startswith(OURS) and path.stat().st_uid == os.getuid():
                own.add(path.name)
    return own


def _mapped_by_others() -> set[str]:
    """Names of shared-memory files that another live process has open: they are its own."""
    names = set()
    for maps in Path("/proc").glob("[0-9]*/maps"):
        if maps.parent.name == str(os.getpid()):
            continue
        with contextlib.suppress(OSError):
            for line in maps.read_text(errors="replace").splitlines():
                _, found, name = line.partition(f"{SHARED}/")
                if found:
                    names.add(name.split(" ")[0])
    return names
