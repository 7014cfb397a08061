"""Who writes a recording: a lock on its folder, which ends with the process that holds it."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import time
from pathlib import Path

from ldt_core.base.errors import RecordingError

HELD_ERRORS = (errno.EWOULDBLOCK, errno.EACCES)
RETRY_PERIOD = 0.05  # s between two attempts


class FolderLock:
    """Held from its making to `release`, or to the end of the process, however that comes.

    It is the kernel's (flock) and leaves no file behind. Where a file system has none, as some
    network shares, there is none: `held` is False then.

    Args:
        folder: that nobody else may write to meanwhile.
        patience: how long somebody else may hold it [s].

    Raises:
        RecordingError: somebody else holds it.
    """

    def __init__(self, folder: Path, patience: float = 0.0) -> None:
        self.held = False
        self._descriptor: int | None = None
        with contextlib.suppress(OSError):
            self._descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        if self._descriptor is None:
            return
        until = time.monotonic() + patience
        while not self.held:
            try:
                fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                self.held = True
            except OSError as error:
                if error.errno not in HELD_ERRORS:
                    self.release()
                    return
                if time.monotonic() >= until:
                    self.release()
                    wanted, got = "a recording that nobody is writing", "one that is being written"
                    raise RecordingError(folder, wanted, got) from None
                time.sleep(RETRY_PERIOD)

    def release(self) -> None:
        """Let others write; a second call does nothing."""
        if self._descriptor is not None:
            with contextlib.suppress(OSError):  # a part of the user's own may have closed it
                os.close(self._descriptor)
            self._descriptor = None
            self.held = False

    def __enter__(self) -> FolderLock:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


def is_written(path: Path) -> bool:
    """Whether LDT is writing to a recording, a folder or a file of one, at this moment."""
    try:
        with FolderLock(path if path.is_dir() else path.parent):
            return False
    except RecordingError:
        return True
