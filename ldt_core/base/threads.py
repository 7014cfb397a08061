"""Work among threads, and linear algebra on one.

Several threads of linear algebra split its sums by their number, hence other last bits.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from typing import TypeVar

from threadpoolctl import ThreadpoolController

T = TypeVar("T")


@functools.cache
def _controller() -> ThreadpoolController:
    # What is to be limited must be loaded; 0.1 s, and most work needs none.
    import scipy.linalg  # noqa: F401

    # Finding the loaded libraries takes 3 ms, a tenth of a training.
    return ThreadpoolController()


def one_thread() -> AbstractContextManager[object]:
    """All linear algebra inside runs on one thread, in numpy and scipy alike."""
    return _controller().limit(limits=1)


def cores() -> int:
    """Cores that this process may use: what its affinity and its container leave."""
    from joblib import cpu_count  # 0.1 s to import, and most runs never search

    return cpu_count()


def started_thread(name: str) -> ThreadPoolExecutor:
    """A thread that works off what it is given, one after the other, and lives from now on.

    A pool starts its thread with the first work. Where memory or threads have run out by then, that
    fails behind the work's back: it is queued, and nobody ever does it.

    Raises:
        RuntimeError: no thread can be started.
    """
    pool = ThreadPoolExecutor(1, thread_name_prefix=name)
    pool.submit(int).result()
    return pool


class _Abandoned(Exception):
    """Nobody waits any more for what a thread does."""


#: `ended` of a thread of `spread`: the events of those who wait for it, set when they wait no more.
_waiting = threading.local()


def spread(work: Callable[[int], T], count: int, workers: int) -> Iterator[T]:
    """What comes out for each number below a count, in their order, among so many threads.

    Where the caller is interrupted or gives up, its threads end with the number they are at, and
    so does all that is spread further inside of them.
    """
    outer: tuple[threading.Event, ...] = getattr(_waiting, "ended", ())
    own = threading.Event()

    def one(i: int) -> T:
        # A caller that failed between two results has not closed this; the process ends without it.
        if any(event.is_set() for event in outer) or not threading.main_thread().is_alive():
            raise _Abandoned
        return work(i)

    def among(i: int) -> T:
        _waiting.ended = (*outer, own)
        if own.is_set():
            raise _Abandoned
        return one(i)

    if workers > 1 and count > 1:
        with ThreadPoolExecutor(workers) as pool:
            try:
                yield from pool.map(among, range(count))
            finally:
                own.set()
    else:
        yield from map(one, range(count))
