"""Work that waits for a thread of its own, bounded in count and bytes."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

#: Messages that may wait: 400 experiments of the loop.
MOST_MESSAGES = 2000
#: Size of those that may wait together [bytes]; one alone may be larger.
MOST_BYTES = 256 * 2**20


class Backlog:
    """Hands items to a thread in their order; what comes while too much waits is left out, counted.

    Args:
        work: is called with what was put, on the thread; must not raise.
        messages: most that may wait.
        most_bytes: of those together.
    """

    def __init__(
        self, work: Callable[..., None], messages: int = MOST_MESSAGES, most_bytes: int = MOST_BYTES
    ) -> None:
        self._work, self._messages, self._most = work, messages, most_bytes
        #: Kind → how many were left out.
        self.dropped: Counter[str] = Counter()
        self._waiting: deque[tuple[int, tuple[Any, ...]]] = deque()
        self._size = 0
        self._closed = self._busy = False
        self._news = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="backlog", daemon=True)
        self._thread.start()

    def __len__(self) -> int:
        """Items that wait, the one being worked on included."""
        with self._news:
            return len(self._waiting) + self._busy

    def put(self, kind: str, size: int, *item: Any) -> None:
        """Let an item wait its turn, or leave it out and count it.

        Args:
            kind: under which it is counted.
            size: in bytes.
            item: arguments of the work.
        """
        with self._news:
            full = len(self._waiting) >= self._messages or self._size + size > self._most
            if self._closed or (self._waiting and full):
                self.dropped[kind] += 1
                return
            self._waiting.append((size, item))
            self._size += size
            self._news.notify()

    def close(self, patience: float) -> None:
        """Take nothing more, work on what waits, and give up on it when that takes too long.

        Args:
            patience: longest time without one item done [s].
        """
        with self._news:
            self._closed = True
            self._news.notify()
        left, since = len(self), time.monotonic()
        while self._thread.is_alive() and time.monotonic() - since < patience:
            self._thread.join(0.05)
            if len(self) != left:
                left, since = len(self), time.monotonic()

    def _run(self) -> None:
        while True:
            with self._news:
                self._busy = False
                while not (self._waiting or self._closed):
                    self._news.wait()
                if not self._waiting:
                    return
                size, item = self._waiting.popleft()
                self._size -= size
                self._busy = True
            self._work(*item)
