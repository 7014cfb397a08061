"""What installed packages offer by entry point, looked up once in a process."""

from __future__ import annotations

import functools
import sys
from importlib import metadata


def entry_points(group: str) -> metadata.EntryPoints:
    """Entry points of a group, in no particular order."""
    return _found(group, tuple(sys.path))


@functools.lru_cache
def _found(group: str, path: tuple[str, ...]) -> metadata.EntryPoints:
    # Hundreds of small files are read, which takes as long as a training.
    return metadata.entry_points(group=group)
