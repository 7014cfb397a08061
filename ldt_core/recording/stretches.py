"""Channels of a record between its gaps, each stretch on a uniform grid."""

from __future__ import annotations

from typing import Any

import numpy as np

from ldt_core.base.errors import OptionError
from ldt_core.segmenter.resampling import (
    GRID_TOLERANCE,
    Series,
    find_period,
    fits_grid,
    resample,
    split_at_gaps,
)

MOST_SAMPLES = 100_000_000  # of a stretch; more is a period in the wrong unit


def stretches(series: dict[str, Series], period: float) -> list[dict[str, Series]]:
    """The series cut at the gaps of all channels but a voltage that has its own times.

    A voltage command of its own topic may be sent only when it changes; it holds meanwhile.
    """
    speed = series["speed"]
    parts = [(s.time[0], s.time[-1]) for s in _parts(speed, period)]
    current = series.get("current")
    if current is not None and current.time is not speed.time:
        own = find_period(current.time) if current.time.size > 1 else period
        spans = [(s.time[0], s.time[-1]) for s in _parts(current, own)]
        parts = [
            (max(a, c), min(b, d)) for a, b in parts for c, d in spans if max(a, c) <= min(b, d)
        ]
    begins = series["voltage"].time[0]  # before it there is no voltage
    parts = [(max(a, begins), b) for a, b in parts if b >= begins]
    return [{q: _between(s, a, b, q == "voltage") for q, s in series.items()} for a, b in parts]


def _parts(series: Series, period: float) -> list[Series]:
    cuts = split_at_gaps(series.time, period)
    return [Series(series.time[cut], series.values[cut], series.place) for cut in cuts]


def _between(series: Series, begin: float, end: float, held: bool) -> Series:
    """Samples from begin to end, with the neighbours that interpolation or holding needs."""
    first = max(int(np.searchsorted(series.time, begin, side="right")) - 1, 0)
    last = int(np.searchsorted(series.time, end, side="right" if held else "left"))
    cut = slice(first, last + (not held))
    return Series(series.time[cut], series.values[cut], series.place)


def first_gap(series: dict[str, Series], period: float) -> str:
    """Behind which sample the first one is."""
    speed = series["speed"]
    end = split_at_gaps(speed.time, period)[0].stop
    return speed.place(end - 1) if end < speed.time.size else "one in the current"


def on_grid(part: dict[str, Series], period: float) -> tuple[np.ndarray, dict[str, Any], bool]:
    """(times, channel → values on them, whether they were resampled)."""
    speed = part["speed"]
    shared = all(s.time.size == speed.time.size for s in part.values()) and all(
        np.array_equal(s.time, speed.time) for s in part.values()
    )
    if shared and fits_grid(speed.time, period):
        return speed.time, {q: s.values for q, s in part.items()}, False
    begin = max(s.time[0] for s in part.values())
    later = speed.time[speed.time >= begin]
    begin = later[0] if later.size else begin  # on a measured speed, which then needs no change
    end = min(s.time[-1] for q, s in part.items() if q != "voltage")
    # A clock's rounding must not cost the last sample, and with it the last experiment.
    count = max((end - begin) / period + GRID_TOLERANCE + 1, 0)
    if count > MOST_SAMPLES:
        raise OptionError("--sample-period", f"at most {MOST_SAMPLES} samples", f"{count:.3g}")
    grid = begin + period * np.arange(int(count))
    columns = {q: resample(s, grid, period, held=q == "voltage") for q, s in part.items()}
    return grid, columns, True
