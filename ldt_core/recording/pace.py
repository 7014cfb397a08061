"""How fast a recording is played."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterable, Iterator

from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Experiment


def parse_rate(text: str) -> float | None:
    """Speed relative to real time; None for as fast as it goes ("max").

    Raises:
        OptionError: neither "max" nor a number above 0.
    """
    if text == "max":
        return None
    try:
        rate = float(text)
    except ValueError:
        rate = math.nan
    if not (math.isfinite(rate) and rate > 0):
        raise OptionError("rate", "max or a number above 0", repr(text))
    return rate


def paced(
    experiments: Iterable[Experiment], rate: float | None, stop: threading.Event | None = None
) -> Iterator[Experiment]:
    """The experiments, each handed on when a machine would have finished it.

    Args:
        experiments: in their order.
        rate: relative to real time; None hands them on at once.
        stop: once it is set there are no more.
    """
    stop = stop or threading.Event()
    wall = first = None
    for experiment in experiments:
        if wall is None or first is None:
            wall, first = time.monotonic(), experiment.start
        if rate is not None:
            left = max(0.0, wall + (experiment.end - first) / rate - time.monotonic())
            stop.wait(min(left, threading.TIMEOUT_MAX))  # no clock counts more
        if stop.is_set():
            return
        yield experiment
