"""Whether a recording's times can be right, before and beside a cause in the machine.

Rows that repeat are no samples: a held speed comes late, which looks like a delay of the machine. A
period that is wrong by a factor makes all time constants wrong by it, which looks like an inertia.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.diagnosis import HeldOutErrors, ParameterAmount
from ldt_core.diagnosis.holdout import errors, free_run
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.machine.machine_file import Machine
from ldt_core.machine.sensor_check import FALSE_ALARM

#: Factors on the period that are tried, one decade to either side, before the best is refined:
#: near enough to each other that a run-up's time constant is met within a third.
FACTORS = np.geomspace(0.1, 10.0, 13)
#: Least factor that is told: a clock that is wrong is so by more than the laws' errors.
LEAST_FACTOR = 1.2


def without_repeats(experiments: Sequence[Experiment]) -> tuple[list[Experiment], str]:
    """(the experiments, each row once where all come several times, a note or "" if none does)."""
    kept, note = [], ""
    for e in experiments:
        times, first = _repeats(e)
        if times > 1:
            # The first kind may have begun before the recording, and goes on into it.
            rows = np.unique([0, *range(first, len(e), times)])
            before = first - times if first else 0  # samples
            note = note or (
                f"experiment {e.number}: each sample is there {times} times; "
                f"one of each was taken, every {times * e.period:g} s"
            )
            e = replace(
                e,
                start=e.start + before * e.period,
                period=times * e.period,
                voltage=e.voltage[rows],
                speed=e.speed[rows],
                current=None if e.current is None else e.current[rows],
            )
        kept.append(e)
    return kept, note


def _repeats(e: Experiment) -> tuple[int, int]:
    """(how often each row comes, the first that is the first of its kind); (1, 0) if only once.

    Rows then change at every n-th sample only. By chance so many changes would not all fall there.
    """
    moved = np.diff(e.speed) != 0
    count = int(moved.sum())
    for channel in (e.voltage, *(() if e.current is None else (e.current,))):
        moved = moved | (np.diff(channel) != 0)
    at = np.flatnonzero(moved) + 1
    times = int(np.gcd.reduce(np.diff(at))) if at.size > 1 else 1
    if times < 2 or (count - 1) * math.log(times) < -math.log(FALSE_ALARM):
        return 1, 0
    return times, int(at[0] % times)


def wrong_clock(
    machine: Machine, held: Sequence[Experiment], before: HeldOutErrors, noise: float
) -> str:
    """The note where another sample period explains the gap as a cause would; "" if none does.

    Args:
        held: experiments that were held out.
        before: the machine file's errors on them.
        noise: deviation of the sensor's there [rad/s].
    """
    gap = before.rmse**2 - noise**2
    if not (math.isfinite(gap) and gap > 0):
        return ""

    def left(exponent: float, seen: Sequence[Experiment] = held[:1]) -> float:
        there = [replace(e, period=e.period * math.exp(exponent)) for e in seen]
        power = errors(seen, [free_run(machine, e) for e in there]).rmse ** 2 - noise**2
        return power if math.isfinite(power) else math.inf

    tried = np.log(FACTORS)
    best = int(np.argmin([left(float(f)) for f in tried]))
    near = (tried[max(best - 1, 0)], tried[min(best + 1, tried.size - 1)])
    found = minimize_scalar(left, bounds=near, method="bounded", options={"xatol": 1e-3}).x
    if abs(found) < math.log(LEAST_FACTOR):
        return ""
    if left(found, held) > THRESHOLDS.departure_of_law * gap:
        return ""
    return (
        f"check the recorded times: a sample period {math.exp(found):.3g} times as long "
        "explains the gap without any change of the machine"
    )


def counted_speed(
    found: Mapping[str, Mapping[str, ParameterAmount]], experiments: Sequence[Experiment]
) -> str:
    """The note where a delay is one of half a sample, as of a speed that is counted; else "".

    An encoder's pulses over one sample give the mean speed in it, that of half a sample before.

    Args:
        found: amounts by effect and parameter, as `attribution.amounts`.
    """
    delay = found.get("input_delay", {}).get("delay")
    periods = {e.period for e in experiments}
    if delay is None or delay.ci95 is None or len(periods) != 1:
        return ""
    half, (low, high) = periods.pop() / 2, delay.ci95
    if not (low <= half <= high and high - low < half):  # told from none and from a whole sample
        return ""
    return (
        f"the delay is half a sample ({half:.3g} s), as of a speed counted over each sample; "
        "if so, state it in the machine file, under effects"
    )
