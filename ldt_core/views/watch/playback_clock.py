"""The time of a recording that is played: it goes on at a rate, is paused, and is set."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any

NOTICE = 0.2  # s, how late a stop may be noticed


class PlaybackClock:
    """Used by the thread that plays and by those that people's browsers are answered on.

    Args:
        rate: recorded seconds in one of ours; None as fast as it goes.
        total: experiments in the recording, None where it does not say.
        clock: of the time that passes [s].
    """

    def __init__(
        self,
        rate: float | None,
        total: int | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.rate, self.total = rate, total
        self.paused = False
        #: Whether all has been played, and nobody has gone back yet.
        self.ended = False
        #: Experiments that were begun, the present one included.
        self.position = 0
        self._begun = 0.0  # recorded time at which the present one began [s]
        self._at: float | None = None  # recorded time at `_since` [s]
        self._since = 0.0
        self._target: int | None = None
        self._clock = clock
        self._changed = threading.Condition()

    def state(self) -> dict[str, Any]:
        """In JSON types; `elapsed` is recorded time since the present experiment began [s]."""
        with self._changed:
            now = self._now()
            return {
                "paused": self.paused,
                "ended": self.ended,
                "rate": self.rate,
                "position": self.position,
                "total": self.total,
                "elapsed": None if now is None else round(now - self._begun, 2),
            }

    def pause(self, paused: bool) -> None:
        """Hold time, or let it go on."""
        with self._changed:
            self._set(self._now())
            self.paused = paused
            self._changed.notify_all()

    def seek(self, position: int) -> None:
        """Go to the end of an experiment, by its place in the recording, from 1."""
        with self._changed:
            self._target = max(1, position)
            self._changed.notify_all()

    def begin(self, start: float) -> None:
        """The next experiment begins, at this recorded time [s]."""
        with self._changed:
            self.position += 1
            self._begun = start

    def rewind(self) -> None:
        """The recording is played from its beginning once more."""
        with self._changed:
            self.position, self._at = 0, None

    def reach(self, moment: float, ahead: int, stop: threading.Event) -> bool:
        """Wait for a recorded time; False where what was played has to be played again.

        Args:
            moment: recorded time [s]; at the first call time begins.
            ahead: experiments that will have begun when it is reached.
            stop: ends the waiting.
        """
        with self._changed:
            if self._at is None:
                self._set(moment)
            while not stop.is_set():
                if self._target is not None and self._target < self.position:
                    return False
                if self._target is not None and ahead <= self._target:
                    return True
                if self._target is not None:
                    self._target = None
                    self._set(moment)
                left = self._left(moment)
                if not self.paused and left <= 0:
                    return True
                self._changed.wait(min(left, NOTICE) if not self.paused else NOTICE)
            return True

    def wait_for_seek(self, stop: threading.Event) -> bool:
        """At the recording's end: whether it is to be played again, and not to stop."""
        with self._changed:
            self.ended = True
            while not stop.is_set():
                if self._target is not None and self._target < self.position:
                    self.ended = False
                    return True
                self._target = None
                self._changed.wait(NOTICE)
            return False

    def _left(self, moment: float) -> float:
        """Of our seconds."""
        now = self._now()
        if self.rate is None or now is None:
            return 0.0
        return (moment - now) / self.rate

    def _now(self) -> float | None:
        if self._at is None or self.paused or self.rate is None:
            return self._at
        return self._at + (self._clock() - self._since) * self.rate

    def _set(self, at: float | None) -> None:
        self._at = at if at is None or math.isfinite(at) else None
        self._since = self._clock()
