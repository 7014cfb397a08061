"""The time of messages that have none."""

from __future__ import annotations


class ArrivalClock:
    """Gives a message without a stamp the time of its arrival, on the clock of those with one.

    The stamps' clock is taken to be behind ours by as much as the last stamped message was: what is
    handled late after a stall is late alike, and a machine's clock need not be set to ours.
    """

    def __init__(self) -> None:
        self._behind = 0.0

    def stamped(self, stamp: float, now: float) -> float:
        """Time of a message with a stamp that arrives now [s]."""
        self._behind = now - stamp
        return stamp

    def unstamped(self, now: float) -> float:
        """Time of a message without one that arrives now [s]."""
        return now - self._behind
