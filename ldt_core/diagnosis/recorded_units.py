"""Whether a recorded speed is in rad/s, and counts the way the voltage drives it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ldt_core.base.experiment import Experiment, Samples, rms
from ldt_core.base.sentences import listed
from ldt_core.base.units import UNITS
from ldt_core.diagnosis.diagnosis import HeldOutErrors
from ldt_core.diagnosis.holdout import errors, free_run
from ldt_core.diagnosis.recorded_times import wrong_clock
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.machine.machine_file import Machine

#: Of the larger of both motions' power, a gap: the unit nearest to rad/s, or the sign, makes more.
LEAST_GAP = 0.5
#: Of a note that the recording, not the machine, is to be mended.
FITS = "it is what the machine file's motor does"


def misread(
    machine: Machine, held: Sequence[Experiment], before: HeldOutErrors, noise: float
) -> str:
    """The note where a unit of speed or time, or a sign, explains the gap; see below.

    Args:
        noise: deviation of the sensor's in these experiments [rad/s].
    """
    return wrong_unit(machine, held, before) or wrong_clock(machine, held, before, noise)


def wrong_unit(machine: Machine, held: Sequence[Experiment], before: HeldOutErrors) -> str:
    """The note where the speed in another unit is what the machine file's motor does; "" if none.

    Args:
        held: experiments that were held out.
        before: the machine file's errors on them.
    """
    gap = before.rmse**2
    if not gap > LEAST_GAP * _power([e.speed for e in held]):  # nor where it is no number
        return ""
    if not gap > LEAST_GAP * _power([free_run(machine, e) for e in held]):
        return ""
    names = {factor: unit for unit, factor in reversed(UNITS["speed"].items())}
    left = {
        (unit, sign): _left(machine, held, sign * factor)
        for factor, unit in names.items()
        for sign in (1, -1)
    }
    found = [tried for tried, part in left.items() if part < THRESHOLDS.departure_of_law]
    if not found:
        return ""
    units = [unit for unit, _ in found if unit != "rad/s"]
    turned = any(sign < 0 for _, sign in found)
    what = ["unit"] * bool(units) + ["sign"] * turned
    how = [f"in {listed(units, 'or')}"] if units else []
    how += ["the other way round"] * turned
    command = f" (ldt import --speed NAME:{units[0]})" if units else ""
    return f"check the {' and '.join(what)} of the speed: {' and '.join(how)} {FITS}{command}"


def _left(machine: Machine, held: Sequence[Experiment], factor: float) -> float:
    """Power of the errors as a part of the motion's, with the speed so many times as large."""
    there = [replace(e, speed=factor * e.speed) for e in held]
    power = errors(there, [free_run(machine, e) for e in there]).rmse ** 2
    return power / max(_power([e.speed for e in there]), 1e-300)


def _power(speeds: Sequence[Samples]) -> float:
    return rms(np.concatenate(speeds)) ** 2
