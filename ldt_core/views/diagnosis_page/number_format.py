"""Numbers, units and names of a diagnosis as a person reads them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeGuard

from ldt_core.base.sentences import number
from ldt_core.diagnosis.diagnosis import ParameterAmount
from ldt_core.effects import EFFECTS, get_effect
from ldt_core.views.page.style import SUPERSCRIPT

NOTHING = "–"
SMALLEST, LARGEST = 1e-3, 1e6  # what is written without a power of ten
MOST_DIGITS = 7  # of an amount

SYMBOLS = {"rad/s^2": "rad/s²", "N m s^2": "N m s²", "Ohm": "Ω"}


def known(value: float | None) -> TypeGuard[float]:
    """Whether there is such a number."""
    return value is not None and math.isfinite(value)


def value_of(value: float | None, digits: int = 3) -> str:
    """A number with so many digits, with a power of ten where it is very small or large.

    >>> value_of(-0.0123), value_of(0.0000021), value_of(None), value_of(0.0)
    ('−0.0123', '2.10 · 10⁻⁶', '–', '0')
    """
    if not known(value):
        return NOTHING
    if value < 0:
        return f"−{value_of(-value, digits)}"
    # Rounded first: 0.09996 is 0.100, not 0.1000.
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    rounded = float(f"{mantissa}e{exponent}")
    if rounded == 0 or SMALLEST <= rounded < LARGEST:
        return number(rounded, digits)
    return f"{mantissa} · 10{str(int(exponent)).translate(SUPERSCRIPT)}"


def percent(fraction: float | None) -> str:
    """A share in per cent, with one decimal where whole numbers would hide what is left.

    >>> percent(0.123), percent(0.9962), percent(-1.2), percent(None)
    ('12 %', '99.6 %', '−120 %', '–')
    """
    if not known(fraction):
        return NOTHING
    hundredth = abs(100 * fraction)
    fine = 0.05 <= hundredth < 1 or 99 < hundredth < 99.95
    text = f"{hundredth:.1f}" if fine else f"{hundredth:.0f}"
    return f"{'−' if fraction < 0 and float(text) else ''}{text} %"


def percents(interval: Sequence[float]) -> str:
    """An interval of shares.

    >>> percents((0.91, 0.97))
    '91 % to 97 %'
    """
    return f"{percent(interval[0])} to {percent(interval[1])}"


def unit_of(unit: str) -> str:
    """As it is printed."""
    return SYMBOLS.get(unit, unit)


def amount(name: str, found: ParameterAmount) -> tuple[str, str]:
    """A parameter, and its interval, in digits that show the interval's width.

    >>> amount("e", ParameterAmount(0.0049, "m", (0.0047, 0.0051)))
    ('e = 4.90 mm', '4.70 to 5.10')
    >>> amount("factor", ParameterAmount(1.30004, "", (1.30001, 1.30009)))
    ('factor = 1.30004', '1.30001 to 1.30009')
    """
    if found.ci95 is None:
        return name, "not determined"
    scale, unit = (1e3, "mm") if found.unit == "m" and abs(found.value) < 1 else (1.0, found.unit)
    digits, width = 3, abs(found.ci95[1] - found.ci95[0])
    if 0 < width < math.inf and found.value:
        digits = 2 + math.floor(math.log10(abs(found.value) / width))
        digits = min(max(digits, 3), MOST_DIGITS)
    value, *ends = (value_of(scale * v, digits) for v in (found.value, *found.ci95))
    return f"{name} = {value} {unit_of(unit)}".rstrip(), " to ".join(ends)


def description(effect: str) -> str:
    """What an effect of the library is; nothing for a user's own, whose file is not run here."""
    return get_effect(effect).description if effect in EFFECTS.builtin else ""
