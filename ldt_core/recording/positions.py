"""Speeds out of measured positions, such as an encoder's counts.

The difference of two positions over the time between them is the mean speed there, and up to the
square of a sample period that of the middle. So that is its time: a speed that stands at the later
position is half a sample late, and one that reaches over two periods begins to change before the
voltage does. The voltage becomes its mean from one such time to the next (the same volt-seconds).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.errors import RecordingError
from ldt_core.base.sentences import counted
from ldt_core.base.units import TURN
from ldt_core.segmenter.resampling import (
    GAP_PERIODS,
    GRID_TOLERANCE,
    Series,
    check_times,
    find_period,
    held_mean,
)

COUNTER_BITS = (16, 24, 32)  # of the counters of encoders, which begin again behind their last
LEAST_RATIO = 10.0  # of a step to those beside it that way: no shaft moves so far in one alone
DOUBTFUL_STEP = 0.4  # turns; from a half on, the direction is lost
WHOLE = 0.01  # of a count or a turn by which rounded numbers may be off


def speed_of_positions(
    where: str, position: Series, voltage: Series, unit: float
) -> tuple[Series, Series, list[str]]:
    """(speed [rad/s], voltage [V], notes), both in the middle between two positions.

    Args:
        where: whose they are, for messages.
        position: [rad]; it may begin again behind a turn, or as a counter does.
        voltage: [V], held from each of its times on.
        unit: [rad] of one unit of the position as it was read.

    Raises:
        RecordingError: too few positions, times that do not increase, or a jump.
    """
    for one in (position, voltage):
        check_times(where, one)
    time = position.time
    if time.size < 2:
        raise RecordingError(where, "2 positions or more", time.size)
    period = find_period(time)
    steps, apart = np.diff(position.values), np.diff(time)
    steps, notes = _unwrapped(steps, float(np.ptp(position.values)), unit)
    middle = (time[:-1] + time[1:]) / 2
    kept = np.flatnonzero((apart <= GAP_PERIODS * period) & (middle >= voltage.time[0]))
    _refuse_jump(where, position, steps, kept, 2 * abs(unit))
    if kept.size == 0:
        raise RecordingError(where, "positions beside a voltage", "none")
    middle, steps, apart = middle[kept], steps[kept], apart[kept]
    ends = np.append(middle[1:], middle[-1] + period)
    ends = np.where(ends - middle > GAP_PERIODS * period, middle + period, ends)
    near = GRID_TOLERANCE * period  # by which a clock's rounding may be off
    mean = held_mean(voltage, middle, ends, near)

    def place(index: int) -> str:
        return position.place(int(kept[index]))

    notes += _fineness(position, unit, period)
    return Series(middle, steps / apart, place), Series(middle, mean, place), notes


def _unwrapped(steps: Array, reach: float, unit: float) -> tuple[Array, list[str]]:
    """(steps [rad] without those by which the position begins again, notes).

    It begins again behind what it never exceeds, if it moves by more than the half of that at once.
    """
    known = {"a turn": TURN, **{f"{bits} bits": 2**bits * abs(unit) for bits in COUNTER_BITS}}
    largest = float(np.abs(steps).max())
    for words, whole in known.items():
        if reach <= whole * (1 + WHOLE) and largest > whole / 2:
            turned = np.rint(steps / whole)
            steps = steps - turned * whole
            times = counted(int(np.count_nonzero(turned)), "time")
            notes = [f"the position begins again behind {words}, {times}"]
            share = float(np.abs(steps).max()) / whole
            if share > DOUBTFUL_STEP:
                notes.append(
                    f"beware: it moves by up to {share:.2g} of that between two samples; from a "
                    "half on the direction is lost, and a shorter sample period is needed"
                )
            return steps, notes
    return steps, []


def _refuse_jump(
    where: str, position: Series, steps: Array, kept: NDArray[np.intp], least: float
) -> None:
    """Refuse (RecordingError) a counter that is set to another number, or misread; names the first.

    A step up to `least` [rad] is none: in a wrong unit, each count of an encoder looks like one.
    """
    moved = np.zeros(steps.size + 2)
    moved[kept + 1] = steps[kept]  # none in a pause, in which it may have moved
    way, size = np.sign(moved[1:-1]), np.abs(moved[1:-1])
    beside = np.maximum(np.maximum(way * moved[:-2], way * moved[2:]), 0)
    found = np.flatnonzero((size > max(TURN / 2, least)) & (size > LEAST_RATIO * beside))
    if found.size:
        at = int(found[0])
        expected = "a position without jumps (leave the row out, or import each part)"
        before, now = position.values[at : at + 2]
        raise RecordingError(
            f"{where}, {position.place(at + 1)}", expected, f"{now:.6g} rad after {before:.6g} rad"
        )


def _fineness(position: Series, unit: float, period: float) -> list[str]:
    """The note on how finely the speed is known, where the positions are counts."""
    counts = position.values / unit
    if np.abs(counts - np.rint(counts)).max() > WHOLE:
        return []
    return [
        f"one count is {abs(unit):.3g} rad, so the speed has steps of {abs(unit) / period:.3g} "
        "rad/s; a longer --sample-period makes them finer"
    ]
