"""Long work in pieces: whoever waits for it decides after each piece whether it goes on."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeVar

T = TypeVar("T")

#: Yields how much it has done since the last time, in a measure of its own; returns what comes of
#: it.
Pausable = Generator[int, None, T]


def finished(work: Pausable[T]) -> T:
    """What comes of it, done without a pause."""
    while True:
        try:
            next(work)
        except StopIteration as end:
            found: T = end.value
            return found


def within(work: Pausable[T], most: int) -> Pausable[T | None]:
    """What comes of it, None where it takes more than this."""
    done = 0
    while done < most:
        try:
            piece = next(work)
        except StopIteration as end:
            found: T = end.value
            return found
        done += piece
        yield piece
    return None
