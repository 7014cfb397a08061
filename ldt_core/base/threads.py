"""Work among threads, and linear algebra on one.

Several threads of linear algebra split its sums by their number, hence other last bits.
"""

from __future__ import annotations

import functools
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


def spread(work: Callable[[int], T], count: int, workers: int) -> Iterator[T]:
    """What comes out for each number below a count, in their order, among so many threads."""
    if workers > 1 and count > 1:
        with ThreadPoolExecutor(workers) as pool:
            yield from pool.map(work, range(count))
    else:
        yield from map(work, range(count))
