"""Measured samples at any times → samples on a uniform grid.

The voltage is held from its last sample (that is what a voltage source does); where it changes
within a new period, it becomes its mean over that (the same volt-seconds). Where the new period is
no longer than the old one, the other channels are interpolated linearly. Where it is longer, taking
single samples would fold fast noise into the result: they become their mean over one period centred
on the sample (no lag, first zero at the new sampling rate).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ldt_core.base.errors import RecordingError
from ldt_core.base.experiment import Samples

GAP_PERIODS = 3.5  # a longer pause between samples is a gap: three lost samples are bridged
LOST_STEPS = 1.5  # median steps; a longer one has a lost sample and tells no period
GRID_TOLERANCE = 0.02  # of a period: samples this close to the grid are taken as they are
DOWNSAMPLING_RATIO = 1.5  # new period over old one from which means are taken
PERIOD_DIGITS = 4  # significant digits to which a period is rounded, if the samples agree


class Series(NamedTuple):
    """One channel as it was measured: times (n,) [s] and values (n,) in SI units.

    `place` says where the sample of an index stands ("line 12"), for messages.
    """

    time: Samples
    values: Samples
    place: Callable[[int], str]


def check_times(where: str, series: Series) -> None:
    """Refuse (RecordingError) times that do not increase; names the first."""
    bad = np.flatnonzero(np.diff(series.time) <= 0)
    if bad.size:
        at = int(bad[0]) + 1
        before, now = series.time[at - 1], series.time[at]
        twice = before == now
        word = "the same time again" if twice else f"{now:.10g} s after {before:.10g} s"
        more = f" ({bad.size} such places)" if bad.size > 1 else ""
        step = "leave out what is there twice" if twice else "import each part by itself"
        raise RecordingError(
            f"{where}, {series.place(at)}", f"increasing times ({step})", word + more
        )


def find_period(time: Samples) -> float:
    """The sample period [s] behind two or more measured times (n,), gaps left aside."""
    steps = np.diff(time)
    period = float(steps[steps <= LOST_STEPS * np.median(steps)].mean())
    rounded = float(f"{period:.{PERIOD_DIGITS}g}")
    parts = split_at_gaps(time, rounded)
    return rounded if all(_grid_index(time[p], rounded) is not None for p in parts) else period


def split_at_gaps(time: Samples, period: float) -> list[slice]:
    """Stretches without a pause of more than GAP_PERIODS periods."""
    cuts = np.flatnonzero(np.diff(time) > GAP_PERIODS * period) + 1
    edges = [0, *cuts.tolist(), time.size]
    return [slice(a, b) for a, b in itertools.pairwise(edges)]


def fits_grid(time: Samples, period: float) -> bool:
    """Whether one stretch of samples can be taken as it is: on the grid, none lost."""
    index = _grid_index(time, period)
    return index is not None and np.array_equal(index, np.arange(time.size))


def _grid_index(time: Samples, period: float) -> np.ndarray | None:
    """Where each sample stands on the grid that begins with the first; None off the grid."""
    index = np.rint((time - time[0]) / period)
    off = np.abs(time - time[0] - index * period).max()
    return index if off <= GRID_TOLERANCE * period else None


def resample(series: Series, grid: Samples, period: float, held: bool) -> Samples:
    """(L,) values on the grid (L,) [s] of that period [s]; see the module's text for the rule.

    `held` channels, a voltage, are constant from one sample to the next.
    """
    time, values = series.time, series.values
    if held:
        return held_mean(series, grid, grid + period, GRID_TOLERANCE * period)
    old = float(np.median(np.diff(time))) if time.size > 1 else period
    if period < DOWNSAMPLING_RATIO * old:
        return np.interp(grid, time, values)
    begin, end = grid - period / 2, grid + period / 2
    # Past the ends there is nothing to average.
    return _mean(series, np.maximum(begin, time[0]), np.minimum(end, time[-1]), held)


def held_mean(series: Series, begin: Samples, end: Samples, near: float) -> Samples:
    """(L,) means of a held channel from these times (L,) to those; its own value where it stays.

    A sample that the clock's rounding puts just behind a beginning (by `near` [s]) counts there.
    """
    first = np.maximum(np.searchsorted(series.time, begin + near, side="right") - 1, 0)
    last = np.maximum(np.searchsorted(series.time, end - near) - 1, first)
    changes = np.concatenate(([0], np.cumsum(np.diff(series.values) != 0)))
    stays = changes[first] == changes[last]
    return np.where(stays, series.values[first], _mean(series, begin, end, held=True))


def _mean(series: Series, begin: Samples, end: Samples, held: bool) -> Samples:
    """(L,) from these times (L,) to those."""
    time, values = series.time, series.values
    whole = _integral(time, values, end, held) - _integral(time, values, begin, held)
    return whole / (end - begin)


def _integral(time: Samples, values: Samples, at: Samples, held: bool) -> Samples:
    """Integral from time[0] of the held or linearly interpolated channel."""
    steps = np.diff(time)
    height = values[:-1] if held else (values[:-1] + values[1:]) / 2
    total = np.concatenate(([0.0], np.cumsum(steps * height)))
    index = np.clip(np.searchsorted(time, at, side="right") - 1, 0, time.size - 1)
    past = at - time[index]
    slope = np.zeros(time.size)
    if not held:
        slope[:-1] = np.diff(values) / steps
    return total[index] + values[index] * past + slope[index] * past**2 / 2
