"""Numbers for people."""

from __future__ import annotations

import math


def number(value: float, digits: int = 3) -> str:
    """A number for people: so many significant digits, never an exponent.

    >>> number(0.12345), number(1234.5), number(-0.0), number(float("inf"))
    ('0.123', '1234', '0', '∞')
    """
    if not math.isfinite(value):
        return "∞" if value > 0 else "−∞" if value < 0 else "unknown"
    if value == 0:
        return "0"
    places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{min(places, 6)}f}"
