"""Ending in order when somebody asks: Ctrl-C, a service manager, a terminal that is closed."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
#: Time that what is under way may take once somebody has asked to end [s]: most is done by then.
LAST_ITEM = 5.0
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


class Stop(threading.Event):
    """Set once somebody has asked to end.

    Attributes:
        making: whether an item of `in_time` is being made.
    """

    making = False

    def in_time(self, items: Iterable[Item]) -> Iterator[Item]:
        """The items up to the first whose making takes longer than `LAST_ITEM` after that.

        It is abandoned wherever it is, as by a kill; between two items nothing is.
        """
        made = iter(items)
        while True:
            self.making = True
            try:
                item = next(made)
            except (StopIteration, _Late):
                return
            finally:
                self.making = False
            yield item

    def late(self, _number: int, _frame: FrameType | None) -> None:
        """Abandon an item that is still being made: the handler of SIGALRM.

        A user's own part may have set an alarm, too; that is not ours.
        """
        if self.making and self.is_set():
            raise _Late


class _Late(KeyboardInterrupt):
    """Of an item that is not worth waiting for any longer."""


def interrupted_by_signals() -> None:
    """Have SIGTERM and SIGHUP interrupt this process as Ctrl-C does, from now on.

    What is under way then cleans up behind itself: no empty folder stays. A signal that the caller
    has ignored, as `nohup` does, stays ignored; a copy of the process ends as it would have.
    """
    owner = os.getpid()

    def interrupt(number: int, _frame: FrameType | None) -> None:
        if os.getpid() == owner:
            raise KeyboardInterrupt
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)

    for number in SIGNALS[1:]:
        if signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, interrupt)


@contextmanager
def stop_on_signals(insist: bool = True) -> Iterator[Stop]:
    """An event that `SIGNALS` set, for as long as the context lasts; `nohup` keeps SIGHUP ignored.

    Args:
        insist: whether a second SIGINT gives up waiting for the end, by KeyboardInterrupt.
    """
    stop = Stop()

    def ask(number: int, _frame: FrameType | None) -> None:
        if insist and stop.is_set() and number == signal.SIGINT:
            raise KeyboardInterrupt
        stop.set()
        if stop.making:
            signal.setitimer(signal.ITIMER_REAL, LAST_ITEM)

    asked = [n for n in SIGNALS if n != signal.SIGHUP or signal.getsignal(n) != signal.SIG_IGN]
    handlers = {**dict.fromkeys(asked, ask), signal.SIGALRM: stop.late}
    previous = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield stop
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
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
