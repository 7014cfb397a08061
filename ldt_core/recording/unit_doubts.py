"""Whether a column that names no unit has the size of another one than SI."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from ldt_core.base.units import has_unit
from ldt_core.segmenter.resampling import Series

# What hardly any motor does, but a column in another unit seems to do.
SLOW, QUICK = 1.0, 1e-6  # s between samples
#: Quantity → (largest size, in which unit, what it is then): a railway's voltage and current;
#: 9549 rpm.
RARE = {
    "voltage": (1000.0, "V", "mV"),
    "speed": (1000.0, "rad/s", "rpm"),
    "current": (1000.0, "A", "mA"),
}
#: [rad/s] 10 rpm: dry friction's sign is smoothed over a fiftieth, which such a speed would show.
SLOW_SHAFT = 1.0
#: Unit that times likely have where so many of them lie between samples: 1 Hz to 1 kHz.
LIKELY = {"ms": 1e3, "us": 1e6, "ns": math.inf}


def unit_doubts(series: Mapping[str, Series], given: Mapping[str, str]) -> list[str]:
    """Where a column that names no unit has the size of another one."""
    bare = [q for q, text in given.items() if not has_unit(text, q)]
    speed, notes = series["speed"], []
    step = float(np.median(np.diff(speed.time))) if speed.time.size > 1 else 0.0
    for quantity, (most, si, unit) in RARE.items():
        measured = series[quantity].values if quantity in series else np.zeros(0)
        largest = float(np.nanmax(np.abs(measured), initial=0.0))
        if quantity in bare and largest > most:
            told = f"{quantity}s up to {largest:.5g} {si} are rare"
            notes.append(_doubt(told, unit, quantity, given, unit))
    fastest = float(np.nanmax(np.abs(speed.values), initial=0.0))
    if "speed" in bare and 0 < fastest < SLOW_SHAFT:
        notes.append(
            f"speeds of at most {fastest:.3g} rad/s are rare; if they are a carriage's in m/s, "
            f"give the motor's rad/s at 1 m/s: --speed {given['speed']}:NUMBER"
        )
    if "position" in given and fastest > RARE["speed"][0]:
        field, _, unit = given["position"].rpartition(":")
        counts = unit if unit.isdecimal() else "COUNTS"
        means = f"if {counts} counts are a turn: --position {field}:{counts}/rev"
        if unit.endswith("/rev"):
            means = "an encoder may give four counts a line"
        notes.append(f"speeds up to {fastest:.5g} rad/s are rare; {means}")
    if "time" in bare and (unit := likely_unit(step)):
        long, named = ("short", "days, as a spreadsheet's dates") if unit == "d" else ("long", unit)
        told = f"{step:.4g} s between samples are {long}"
        notes.append(_doubt(told, named, "time", given, unit))
    return notes


def likely_unit(step: float) -> str:
    """The unit that times likely have which are so far apart; "" if that may be seconds.

    >>> likely_unit(10.0), likely_unit(0.01)
    ('ms', '')
    """
    if 0 < step <= QUICK:
        return "d"
    return next((unit for unit, most in LIKELY.items() if SLOW <= step < most), "")


def _doubt(told: str, named: str, quantity: str, given: Mapping[str, str], unit: str) -> str:
    return f"{told}; if they are {named}: --{quantity} {given[quantity]}:{unit}"
