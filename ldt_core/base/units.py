"""Units that an import converts to SI, and the option syntax FIELD[:UNIT].

A table of our own instead of a units library: the units of four quantities are few, and a speed in
Hz means revolutions per second here, where a library would read radians.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import NamedTuple

from ldt_core.base.errors import OptionError, did_you_mean

TURN = 2 * math.pi  # rad

#: Quantity → unit → SI units in one of it.
UNITS: dict[str, dict[str, float]] = {
    "time": {
        "s": 1,
        "ms": 1e-3,
        "us": 1e-6,
        "µs": 1e-6,
        "ns": 1e-9,
        "min": 60,
        "h": 3600,
        "d": 86400,
    },
    "voltage": {"V": 1, "mV": 1e-3, "uV": 1e-6, "µV": 1e-6, "kV": 1e3},
    "speed": {
        "rad/s": 1,
        "mrad/s": 1e-3,
        "krad/s": 1e3,
        "rad/min": 1 / 60,
        "deg/s": TURN / 360,
        "rpm": TURN / 60,
        "RPM": TURN / 60,
        "1/min": TURN / 60,
        "r/min": TURN / 60,
        "min-1": TURN / 60,
        "U/min": TURN / 60,
        "Upm": TURN / 60,
        "krpm": 1000 * TURN / 60,
        "rps": TURN,
        "rev/s": TURN,
        "Hz": TURN,
    },
    "current": {"A": 1, "mA": 1e-3, "uA": 1e-6, "µA": 1e-6, "kA": 1e3},
}
#: Quantity → names of columns that are its symbol, or its German word, which says no unit either;
#: "v" may be a voltage or a speed, "i" an index.
SYMBOLS = {
    "time": ("t", "zeit"),
    "voltage": ("u", "spannung"),
    "speed": ("n", "w", "omega", "ω", "drehzahl"),
    "current": ("strom",),
}

NO_COLUMNS: Mapping[str, str] = MappingProxyType({})


class Field(NamedTuple):
    """Where a channel comes from: a column or `/topic.field[index]`, and SI units in one of it."""

    quantity: str
    name: str
    factor: float
    unit: str


def parse_field(text: str, quantity: str, columns: Mapping[str, str] = NO_COLUMNS) -> Field:
    """FIELD[:UNIT] of an option.

    Args:
        text: as the user gave it.
        quantity: time, voltage, speed or current.
        columns: name of each that exists → the unit below it, "" where none stands there. A name
            that contains a colon is taken as a whole.

    Raises:
        OptionError: no field, an unknown unit, or none where the name ends in one that is not SI or
            one that is not SI stands below it.
    """
    units = UNITS[quantity]
    si = next(iter(units))
    name, colon, unit = text.rpartition(":")
    if not colon or text in columns:
        name, unit = text, si
        named = _named_unit(text, units)
        says = f"the name says {named}"
        if below := columns.get(text, ""):
            named, says = below.replace("μ", "µ"), f"the row below the names says {below}"
        if named and units.get(named) != 1:
            other = f"{text}:{named} or " if named in units else ""
            raise OptionError(
                f"--{quantity}", f"its unit, {other}{text}:{si}, since {says}", repr(text)
            )
    unit = unit.replace("μ", "µ")  # the Greek letter looks like the micro sign
    if not name.strip():
        raise OptionError(f"--{quantity}", "FIELD or FIELD:UNIT", repr(text))
    if unit not in units:
        raise OptionError(f"--{quantity}, unit", did_you_mean(unit, units), repr(unit))
    return Field(quantity, name.strip(), units[unit], unit)


def propose_fields(columns: Mapping[str, str]) -> dict[str, str]:
    """Quantity → FIELD[:UNIT], where one column alone has its unit, its word, or its symbol.

    A symbol says no unit; the literal "UNIT" stands for it.

    Args:
        columns: name → the unit below it, or "".

    >>> propose_fields({"t": "", "u": "", "n": "", "x": ""})
    {'time': 't:UNIT', 'voltage': 'u:UNIT', 'speed': 'n:UNIT'}
    >>> propose_fields({"time": "", "u [V]": "", "n": "rpm", "Speed (deg/s)": "", "n2": "rpm"})
    {'time': 'time', 'voltage': 'u [V]', 'speed': 'Speed (deg/s):deg/s'}
    """
    proposed = {}
    for quantity, units in UNITS.items():
        told = {name: _named_unit(below or name, units) for name, below in columns.items()}
        found = [name for name in columns if told[name]]
        if len(found) != 1:
            found = [name for name in columns if quantity in name.lower()]
        named = [n for n in columns if n.lower() in SYMBOLS[quantity]]
        words = [w for w in SYMBOLS[quantity] if len(w) > 3]  # "w" is in many a word
        named = named or [n for n in columns if any(w in n.lower() for w in words)]
        if not found and len(named) == 1:
            proposed[quantity] = f"{named[0]}:UNIT"
        if len(found) == 1:
            unit = told[found[0]]
            proposed[quantity] = found[0] + (f":{unit}" if units.get(unit, 1) != 1 else "")
    return proposed


def _named_unit(name: str, units: Collection[str]) -> str:
    """The unit that a name ends in, as of "time_ms", "n [rpm]" or "Speed (RPM)"; "" if in none.

    The longest of all quantities counts: "speed_rad_s" is in rad/s, and no time in s.
    """
    ending = name.strip().rstrip(")]}")
    for unit in sorted({u for of in UNITS.values() for u in of}, key=len, reverse=True):
        for written in (unit, unit.replace("/", "_")):
            before = ending.removesuffix(written)
            if before != ending and not before.endswith("/") and not before[-1:].isalnum():
                return unit if unit in units else ""
    return ""
