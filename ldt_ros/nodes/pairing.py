"""Two topics brought together by experiment number."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

from ldt_core.base.bounded import forget_oldest

Left = TypeVar("Left")
Right = TypeVar("Right")

#: Twice what a topic keeps, which comes at once after its publisher was cut off: what waits longer
#: has lost its other half.
CAPACITY = 200


class Pairing(Generic[Left, Right]):
    """Calls back with both halves of a number, whichever comes first; bounded.

    Args:
        callback: receives (left, right) once per number.
        capacity: halves of one side that may wait; beyond, the oldest is dropped.

    Attributes:
        dropped: halves that were dropped: too long without the other, or of a number that waits
            already (the first of a number is the one that the twin predicts).
        repeated: halves of a number that has met already: somebody was started again, and says
            once more what may not have been heard.
    """

    def __init__(self, callback: Callable[[Left, Right], None], capacity: int = CAPACITY) -> None:
        self.callback = callback
        self.capacity = capacity
        self.dropped = self.repeated = 0
        self._met: dict[int, None] = {}  # the last ones
        self._left: dict[int, Left] = {}
        self._right: dict[int, Right] = {}

    def __len__(self) -> int:
        """Halves that wait."""
        return len(self._left) + len(self._right)

    def left(self, number: int, item: Left) -> None:
        """Take in a left half."""
        if number in self._right:
            self._meet(number, item, self._right.pop(number))
        else:
            self._wait(self._left, number, item)

    def right(self, number: int, item: Right) -> None:
        """Take in a right half."""
        if number in self._left:
            self._meet(number, self._left.pop(number), item)
        else:
            self._wait(self._right, number, item)

    def met(self, number: int) -> None:
        """Take what comes of a number for a repetition from now on."""
        self._met[number] = None
        forget_oldest(self._met, self.capacity)

    def _meet(self, number: int, left: Left, right: Right) -> None:
        self.met(number)
        self.callback(left, right)

    def _wait(self, side: dict[int, Any], number: int, item: Left | Right) -> None:
        if number in self._met:
            self.repeated += 1
            return
        if number in side:
            self.dropped += 1
            return
        side[number] = item
        self.dropped += forget_oldest(side, self.capacity)
