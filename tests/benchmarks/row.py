"""One line of the benchmark table, and how its times are taken."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """A ratio against a named peer, on the same work in the same run.

    Args:
        name: what was done.
        ours_s: our time [s].
        peer: who else did it.
        peer_s: the peer's time [s].
        aim: the ratio aimed at.
        note: sizes, and how equal the results are.
    """

    name: str
    ours_s: float
    peer: str
    peer_s: float
    aim: str
    note: str = ""


def best_of(times: int, work: Callable[[], object]) -> float:
    """Least time of several [s], after one that is not counted (compilation, caches)."""
    work()
    best = float("inf")
    for _ in range(times):
        begin = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - begin)
    return best


def load_average() -> str:
    """How busy the machine is, for a note."""
    return f"load average {os.getloadavg()[0]:.0f}"
