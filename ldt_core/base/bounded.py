"""Mappings that remember the last entries alone."""

from __future__ import annotations

import itertools
from typing import Any


def forget_oldest(kept: dict[Any, Any], most: int) -> int:
    """Take the entries that came first out of a mapping, down to a count; how many they were.

    >>> kept = dict.fromkeys("abcd")
    >>> forget_oldest(kept, 3), list(kept)
    (1, ['b', 'c', 'd'])
    """
    leaving = max(0, len(kept) - most)
    for key in list(itertools.islice(kept, leaving)):
        del kept[key]
    return leaving
