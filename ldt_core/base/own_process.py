"""What a part of the user's own must not do to its process: end it, double it, close its files.

A part may raise SystemExit, which costs its experiment. These go past every handler.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

#: Of `os`: what ends this program without a word, or puts another one in its place.
ENDINGS = ("_exit", "execv", "execve")
#: Ends this process at once, whatever `kept_alive` has put in its place.
leave_at_once = os._exit


@contextmanager
def kept_alive() -> Iterator[None]:
    """While it lasts, what would end this process at once raises SystemExit instead.

    What was sent would stay unanswered, with an exit code that says all is well.
    """
    before = {name: getattr(os, name) for name in ENDINGS}
    for name, ending in before.items():
        setattr(os, name, _raising(name, ending, os.getpid()))
    try:
        yield
    finally:
        for name, ending in before.items():
            setattr(os, name, ending)


def _raising(name: str, ending: Callable[..., NoReturn], owner: int) -> Callable[..., NoReturn]:
    def call(*given: Any) -> NoReturn:
        if os.getpid() != owner:  # one that was forked, as by multiprocessing, ends so by right
            ending(*given)
        raise SystemExit(f"os.{name}({', '.join(map(repr, given[:1]))})")

    return call


@contextmanager
def undivided() -> Iterator[None]:
    """End the copy of this process that `os.fork` within has made, if it comes back from there.

    It would do all that follows a second time: record, publish, print.
    """
    owner = os.getpid()
    try:
        yield
    finally:
        if os.getpid() != owner:
            leave_at_once(0)


class OpenFiles:
    """Notices that all files of this process were closed, its sockets among them.

    Whoever waits for messages would wait for ever. A file that is opened here stands for all.
    """

    def __init__(self) -> None:
        self._ends = os.pipe()
        self._made = os.fstat(self._ends[0]).st_ino

    @property
    def closed(self) -> bool:
        """Whether they were."""
        try:
            return os.fstat(self._ends[0]).st_ino != self._made
        except OSError:
            return True
