"""Files of others, read whole only where they are files and not larger than stated."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import IO

from ldt_core.base.errors import most_alike


def open_regular(path: str | Path) -> IO[bytes]:
    """A file opened for reading; a pipe or a device, which may never end, is none.

    Raises:
        OSError: it cannot be opened, or is no regular file.
    """
    # Without waiting: opening a pipe into which nobody writes would never return.
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    mode = os.fstat(handle).st_mode
    if not stat.S_ISREG(mode):
        os.close(handle)
        raise OSError(errno.EINVAL, "a folder" if stat.S_ISDIR(mode) else "no regular file")
    return open(handle, "rb")


def nothing_there(path: str | Path) -> str:
    """That there is no such file, and the one beside it that is most alike, for a sentence."""
    place = Path(path)
    if place.is_symlink():
        return "a link that leads nowhere"
    try:
        beside = {p.stem: p for p in sorted(place.parent.iterdir())}  # any suffix is like another
        close = beside.get(most_alike(place.stem, beside) or "")
    except (OSError, ValueError):
        close = None
    hint = f" (did you mean {str(close)!r}?)" if close else ""
    return f"no such file or folder{hint}"


def read_bounded(path: str | Path, most: int) -> bytes:
    """All bytes of a file.

    Args:
        path: of the file.
        most: bytes that it may have.

    Raises:
        OSError: as `open_regular`, or it is larger.
    """
    with open_regular(path) as stream:
        data = stream.read(most + 1)
    if len(data) > most:
        raise OSError(errno.EFBIG, f"one that is too large: at most {most} bytes are read")
    return data
