"""A physical parameter: value, unit and bounds in one object."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ldt_core.base.errors import OptionError, described

#: Parameters of a machine or an effect by name, in the units that they declare.
Values = Mapping[str, float]

#: Size of a number, at most, and of one that must not be 0, at least: products of a few of them
#: and their squares stay in the range of floating point. No motor comes near, in whatever unit.
LARGEST, SMALLEST = 1e30, 1e-30
#: Of a parameter's size: a fit stays so far inside an open bound.
OPEN_MARGIN = 1e-6


@dataclass(frozen=True)
class Parameter:
    """A scalar of a machine or an effect.

    Args:
        name: as in the machine file.
        unit: SI unit, for people.
        low: smallest value that physics allows.
        high: largest value that physics allows.
        default: value when the user gives none; None when one must be given.
        description: one line for people.
        open_low: the bound itself is not allowed (a mass of 0).
        scale: typical size, for scaling a fit and for a first guess away from 0.
        relative: where it may be 0 but is not, a fit changes it by factors all the same.
        meant: largest size that a person can mean who types it; more is a slip of the unit.
        idle: of an effect that is known to act, whose default is what is known: the value of no
            effect, where there is one.

    Raises:
        OptionError: a name or unit that is no text, or a negative scale.
    """

    name: str
    unit: str
    low: float = -math.inf
    high: float = math.inf
    default: float | None = None
    description: str = ""
    open_low: bool = False
    scale: float | None = None
    relative: bool = False
    meant: float = math.inf
    idle: float | None = None

    def __post_init__(self) -> None:
        for what, text in (("name", self.name), ("unit", self.unit)):
            if not isinstance(text, str):  # a bound in the unit's place would be its unit
                expected = "a text, as in Parameter(name, unit, low, high, ...)"
                raise OptionError(f"parameter {self.name}, {what}", expected, described(text))
        if self.scale is not None and not self.scale >= 0:
            raise OptionError(
                f"parameter {self.name}, scale", "a size, at least 0", described(self.scale)
            )

    def accepts(self, value: float) -> bool:
        """Whether value is finite and within the bounds."""
        above = value > self.low if self.open_low else value >= self.low
        return math.isfinite(value) and above and value <= self.high

    def least(self, size: float) -> float:
        """The lowest value that a fit may take; `size` is the parameter's on the machine."""
        return self.low + (OPEN_MARGIN * size if self.open_low else 0.0)

    @property
    def cyclic(self) -> bool:
        """Whether it is an angle that may be anything within one turn."""
        return self.unit == "rad" and math.isclose(self.high - self.low, 2 * math.pi)

    @property
    def range(self) -> str:
        """The bounds in words, for messages."""
        left = "above" if self.open_low else "at least"
        parts = []
        if math.isfinite(self.low):
            parts.append(f"{left} {self.low:g}")
        if math.isfinite(self.high):
            parts.append(f"at most {self.high:g}")
        limits = " and ".join(parts) or "a finite number"
        return f"{limits} {self.unit}".rstrip()


def is_own(name: str) -> bool:
    """Whether it is the name of a known effect's parameter."""
    return "." in name


def own_name(effect: str, parameter: str) -> str:
    """What a known effect's parameter is called among those of the machine."""
    return f"{effect}.{parameter}"


def logarithmic(p: Parameter) -> bool:
    """Whether the parameter is a factor or a limit: above 0, and neutral at a positive value."""
    return p.open_low and p.low == 0 and (p.default or 0.0) > 0
