"""Units that an import converts to SI, and the option syntax FIELD[:UNIT] or FIELD[:NUMBER].

A table of our own instead of a units library: the units of four quantities are few, and a speed in
Hz means revolutions per second here, where a library would read radians.
"""

from __future__ import annotations

import math
import re
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
    "position": {"rad": 1, "mrad": 1e-3, "deg": TURN / 360, "rev": TURN, "turn": TURN},
    "current": {"A": 1, "mA": 1e-3, "uA": 1e-6, "µA": 1e-6, "kA": 1e3},
}
#: Quantity → names of columns that are its symbol, or a word for it, which says no unit either;
#: "v" may be a voltage or a speed, "i" an index.
SYMBOLS = {
    "time": ("t", "zeit", "stamp", "unix"),
    "voltage": ("u", "spannung"),
    "speed": ("n", "w", "omega", "ω", "drehzahl", "velocity", "vel"),
    "position": ("angle", "winkel", "theta", "phi", "pos", "counts", "ticks", "encoder"),
    "current": ("strom",),
}

CARRIAGE = "for a carriage {0}:NUMBER, the motor's rad/s at 1 {1}"
POSITION = "of a position `ldt import` makes the speed: --position {0}:UNIT"
SCREW = "for a carriage {0}:NUMBER, the motor's rad at 1 {1}"
COUNTS = "of an encoder the counts in a turn, such as {0}:2048/rev"
SHARE = "for a share of the supply {0}:NUMBER, the V at 1 {1}"
#: Quantity → unit of what is often recorded in its place → what to give then.
FOREIGN: dict[str, dict[str, str]] = {
    "speed": {
        **dict.fromkeys(("m/s", "mm/s", "cm/s", "um/s", "m/min", "mm/min"), CARRIAGE),
        **dict.fromkeys(("m", "mm", "um", "deg", "rad", "rev", "counts"), POSITION),
    },
    "position": {
        **dict.fromkeys(("m", "mm", "um"), SCREW),
        **dict.fromkeys(("counts", "count", "ticks"), COUNTS),
    },
    "voltage": dict.fromkeys(("%", "pct", "percent"), SHARE),
}
#: Words of a name that say a position, where none of the others stands beside them.
POSITIONS = frozenset({"position", "pos", "angle", "winkel", "counts", "ticks"})
RATES = frozenset({"speed", "velocity", "vel", "rate", "dot", "omega"})

NO_COLUMNS: Mapping[str, str] = MappingProxyType({})


class Field(NamedTuple):
    """Where a channel comes from: a column or `/topic.field[index]`, and SI units in one of it."""

    quantity: str
    name: str
    factor: float
    unit: str


def parse_field(text: str, quantity: str, columns: Mapping[str, str] = NO_COLUMNS) -> Field:
    """FIELD[:UNIT] of an option; a number in place of the unit is the SI units in one of it.

    Args:
        text: as the user gave it.
        quantity: time, voltage, speed, position or current. That of a position may be COUNTS/rev.
        columns: name of each that exists → the unit below it, "" where none stands there. A name
            that contains a colon is taken as a whole.

    Raises:
        OptionError: no field, an unknown unit, or none where the name ends in one that is not SI,
            says a position, or one that is not SI stands below it; none of a position at all, as
            those of sensors are rarely in rad.
    """
    units = UNITS[quantity]
    si = next(iter(units))
    name, colon, unit = text.rpartition(":")
    if not colon or text in columns:
        name, unit = text, si
        named, says_other = named_unit(text, units), other_quantity(text, quantity)
        says = f"the name says {named}"
        if below := columns.get(text, ""):
            named, says = below.replace("μ", "µ"), f"the row below the names says {below}"
        elif says_other:
            word, instead = says_other
            expected = f"a {quantity}, as {text}:{si} if it is one ({instead.format(text, word)})"
            raise OptionError(f"--{quantity}", expected, f"{text!r}, whose name says {word}")
        elif quantity == "position" and not named:
            expected = f"its unit, such as {text}:rad, {text}:deg or, {COUNTS.format(text)}"
            raise OptionError("--position", expected, repr(text))
        if named and units.get(named) != 1:
            other = f"{text}:{named} or " if named in units else ""
            raise OptionError(
                f"--{quantity}", f"its unit, {other}{text}:{si}, since {says}", repr(text)
            )
    unit = unit.replace("μ", "µ")  # the Greek letter looks like the micro sign
    if not name.strip():
        raise OptionError(f"--{quantity}", "FIELD or FIELD:UNIT", repr(text))
    if quantity == "position" and (counts := _number(unit.removesuffix("/rev"))) and "/" in unit:
        return Field(quantity, name.strip(), TURN / counts, unit)
    if factor := _number(unit):
        return Field(quantity, name.strip(), factor, f"{unit} {si}")
    if instead := FOREIGN.get(quantity, {}).get(unit, ""):
        expected = f"that of a {quantity}, such as {si} ({instead.format(name, unit)})"
        raise OptionError(f"--{quantity}, unit", expected, repr(unit))
    if unit not in units:
        expected = did_you_mean(unit, units) + ", or COUNTS/rev" * (quantity == "position")
        raise OptionError(f"--{quantity}, unit", expected, repr(unit))
    return Field(quantity, name.strip(), units[unit], unit)


def propose_fields(columns: Mapping[str, str]) -> dict[str, str]:
    """Quantity → FIELD[:UNIT], where one column alone has its unit, its word, or its symbol.

    A symbol says no unit; the literal "UNIT" stands for it. A position takes the place of a speed.

    Args:
        columns: name → the unit below it, or "".

    >>> propose_fields({"t": "", "u": "", "n": "", "x": ""})
    {'time': 't:UNIT', 'voltage': 'u:UNIT', 'speed': 'n:UNIT'}
    >>> propose_fields({"unix_ts": "", "v": ""})
    {'time': 'unix_ts:UNIT'}
    >>> propose_fields({"t": "", "u": "", "theta": ""})["position"]
    'theta:UNIT'
    >>> propose_fields({"time": "", "u [V]": "", "n": "rpm", "Speed (deg/s)": "", "n2": "rpm"})
    {'time': 'time', 'voltage': 'u [V]', 'speed': 'Speed (deg/s):deg/s'}
    """
    proposed = {}
    for quantity, units in UNITS.items():
        told = {name: named_unit(below or name, units) for name, below in columns.items()}
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
            if quantity == "position" and not unit:
                proposed[quantity] += ":UNIT"
    if "speed" in proposed:
        proposed.pop("position", None)
    return proposed


def other_quantity(name: str, quantity: str) -> tuple[str, str] | None:
    """What a column's name says that is no such quantity, and what to give then.

    >>> other_quantity("v_mm_s", "speed")[0], other_quantity("pos_m", "speed")[0]
    ('mm/s', 'pos')
    >>> other_quantity("n_m", "speed"), other_quantity("angle_rate", "speed")
    (None, None)
    """
    foreign = FOREIGN.get(quantity, {})
    unit = named_unit(name, foreign)
    if unit and unit != "m":  # which may be short for a motor's
        return unit, foreign[unit]
    words = re.findall(r"[a-z]+", name.lower())
    said = next((word for word in words if word in POSITIONS), "")
    if quantity != "speed" or not said or RATES.intersection(words):
        return None
    return None if named_unit(name, UNITS[quantity]) else (said, POSITION)


def has_unit(text: str, quantity: str) -> bool:
    """Whether FIELD[:UNIT] says its unit, or a number in its place."""
    unit = text.rpartition(":")[2] if ":" in text else ""
    return unit in UNITS[quantity] or bool(_number(unit))


def is_unit(text: str) -> bool:
    """Whether a text is a unit that some quantity may have, known here or foreign."""
    return any(text in of for table in (UNITS, FOREIGN) for of in table.values())


def _number(text: str) -> float:
    """A finite number other than 0; 0 for anything else."""
    try:
        number = float(text)
    except ValueError:
        return 0.0
    return number if math.isfinite(number) else 0.0


def named_unit(name: str, units: Collection[str]) -> str:
    """The unit that a name ends in, as of "time_ms", "n [rpm]" or "Speed (RPM)"; "" if in none.

    The longest of all quantities counts: "speed_rad_s" is in rad/s, and no time in s.
    """
    ending = name.strip().rstrip(")]}")
    known = {u for table in (UNITS, FOREIGN) for of in table.values() for u in of}
    for unit in sorted(known, key=len, reverse=True):
        for written in (unit, unit.replace("/", "_")):
            before = ending.removesuffix(written)
            if before != ending and not before.endswith("/") and not before[-1:].isalnum():
                return unit if unit in units else ""
    return ""
