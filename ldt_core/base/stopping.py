"""Ending in order when somebody asks: Ctrl-C, or a service manager that stops its unit."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

SIGNALS = (signal.SIGINT, signal.SIGTERM)
#: What the summary of a run says that was ended so.
INTERRUPTED = "interrupted"

#: Exit code of a command that was interrupted, as shells have it.
EXIT_CODE = 128 + signal.SIGINT

Item = TypeVar("Item")


class Interrupted(KeyboardInterrupt):
    """Somebody has asked to end work that can go on.

    Args:
        kept: what is done and where it is, as words behind "after".
        command: that goes on with it; "" is the one that was interrupted.
    """

    def __init__(self, kept: str, command: str = "") -> None:
        self.kept, self.command = kept, command
        super().__init__(kept)


@contextmanager
def stop_on_signals(insist: bool = True) -> Iterator[threading.Event]:
    """An event that SIGINT and SIGTERM set, for as long as the context lasts.

    Args:
        insist: whether a second SIGINT gives up waiting for the end, by KeyboardInterrupt.
    """
    stop = threading.Event()

    def ask(number: int, _frame: FrameType | None) -> None:
        if insist and stop.is_set() and number == signal.SIGINT:
            raise KeyboardInterrupt
        stop.set()

    previous = {number: signal.signal(number, ask) for number in SIGNALS}
    try:
        yield stop
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def until_stopped(items: Iterable[Item], stop: threading.Event) -> Iterator[Item]:
    """The items; for work that is interrupted between two of them, with none half written.

    Raises:
        KeyboardInterrupt: somebody has asked to end.
    """
    for item in items:
        if stop.is_set():
            raise KeyboardInterrupt
        yield item
