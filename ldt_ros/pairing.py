"""Two topics brought together by experiment number."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

Left = TypeVar("Left")
Right = TypeVar("Right")

CAPACITY = 100  # as deep as the topics' queues: what waits longer has lost its other half


class Pairing(Generic[Left, Right]):
    """Calls back with both halves of a number, whichever comes first; bounded.

    Args:
        callback: receives (left, right) once per number.
        capacity: halves of one side that may wait; beyond, the oldest is dropped.

    Attributes:
        dropped: halves that were dropped: too long without the other, or of a number that waits
            already (the first of a number is the one that the twin predicts).
    """

    def __init__(self, callback: Callable[[Left, Right], None], capacity: int = CAPACITY) -> None:
        self.callback = callback
        self.capacity = capacity
        self.dropped = 0
        self._left: dict[int, Left] = {}
        self._right: dict[int, Right] = {}

    def __len__(self) -> int:
        """Halves that wait."""
        return len(self._left) + len(self._right)

    def left(self, number: int, item: Left) -> None:
        """Take in a left half."""
        if number in self._right:
            self.callback(item, self._right.pop(number))
        else:
            self._wait(self._left, number, item)

    def right(self, number: int, item: Right) -> None:
        """Take in a right half."""
        if number in self._left:
            self.callback(self._left.pop(number), item)
        else:
            self._wait(self._right, number, item)

    def _wait(self, side: dict, number: int, item: Left | Right) -> None:
        if number in side:
            self.dropped += 1
            return
        side[number] = item
        if len(side) > self.capacity:
            del side[next(iter(side))]
            self.dropped += 1
