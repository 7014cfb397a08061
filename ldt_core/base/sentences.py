"""Names and numbers as a person reads them in a sentence."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

Span = tuple[int, int]  # first and last of whole numbers without a gap

MOST_COUNTED = 1e15  # whole numbers that a float tells apart
MOST_PLACES = 6  # behind the point; more zeros are miscounted


def number(value: float, digits: int = 3) -> str:
    """A number with so many significant digits; an exponent only where zeros are not counted.

    >>> number(0.12345), number(1234.5), number(-0.0), number(float("inf")), number(2e300)
    ('0.123', '1234', '0', '∞', '2e+300')
    >>> number(0.000161), number(4.6e-6)
    ('0.000161', '4.6e-06')
    """
    if not math.isfinite(value):
        return "∞" if value > 0 else "−∞" if value < 0 else "unknown"
    if value == 0:
        return "0"
    places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    if abs(value) >= MOST_COUNTED or places > MOST_PLACES:
        return f"{value:.{digits}g}"
    return f"{value:.{places}f}"


def plain(value: float, digits: int = 3) -> str:
    """The same without the zeros behind it.

    >>> plain(20.0, 4), plain(12345.6, 4), plain(0.1)
    ('20', '12346', '0.1')
    """
    text = number(value, digits)
    return text.rstrip("0").rstrip(".") if "." in text else text


def measured(value: float, unit: str, ci95: tuple[float, float] | None) -> str:
    """A value with as many digits as it is known to, lengths in mm.

    >>> measured(0.0049123, "m", (0.0047, 0.0051)), measured(412.0, "s", None)
    ('4.91 ± 0.21 mm', 'near 4.1e+02 s, but not determined')
    """
    unit, scale = ("mm", 1e3) if unit == "m" else (unit, 1.0)
    if ci95 is None:
        return f"near {value * scale:.2g} {unit}".rstrip() + ", but not determined"
    spread = max(ci95[1] - value, value - ci95[0]) * scale
    digits = max(0, 1 - int(f"{spread:e}".split("e")[1])) if spread > 0 else 3
    shown = f"{value * scale:.{min(digits, 9)}f}" if digits < 6 else f"{value * scale:.3g}"
    return f"{shown} ± {spread:.2g} {unit}".rstrip()


def listed(names: Iterable[str], last: str = "and") -> str:
    """All of them.

    >>> listed(["a", "b", "c"], "or")
    'a, b or c'
    """
    *most, end = names
    return f"{', '.join(most)} {last} {end}" if most else end


def some(names: Sequence[str], most: int = 20) -> str:
    """As many as a line shows, the topics of a whole run for one, and how many more there are.

    >>> some(["a", "b", "c", "d"], 2)
    'a, b and 2 more'
    """
    more = [f"{len(names) - most} more"] if len(names) > most else []
    return listed([*names[:most], *more]) if names else ""


def spoken(name: str) -> str:
    """A name of the code, an effect's for one, as words.

    >>> spoken("coulomb_friction")
    'coulomb friction'
    """
    return name.replace("_", " ")


def confident(confidence: float) -> str:
    """How far to trust an answer.

    >>> confident(0.874), confident(0.9975)
    ('Confidence: 87%.', 'Confidence: above 99%.')
    """
    return f"Confidence: {certainty(confidence)}."


def certainty(confidence: float) -> str:
    """A confidence in per cent, never 100."""
    return "above 99%" if confidence > 0.99 else f"{confidence:.0%}"


def counted(number: int, thing: str) -> str:
    """So many of them.

    >>> counted(1, "experiment"), counted(2, "experiment")
    ('1 experiment', '2 experiments')
    """
    return f"{number} {thing}" + ("" if number == 1 else "s")


def few(names: Sequence[str], most: int) -> str:
    """The first ones, and how many more there are.

    >>> few(["a", "b", "c", "d"], 2)
    'a, b and 2 more'
    """
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def spans(numbers: Iterable[int]) -> list[Span]:
    """Whole numbers as stretches without a gap.

    >>> spans([9, 7, 8, 12])
    [(7, 9), (12, 12)]
    """
    found: list[Span] = []
    for number in sorted(set(numbers)):
        if found and number == found[-1][1] + 1:
            found[-1] = (found[-1][0], number)
        else:
            found.append((number, number))
    return found


def ranges(stretches: Iterable[Span], most: int | None = None) -> str:
    """Whole numbers in words, of many stretches the first ones.

    >>> ranges(spans([7, 8, 9, 12])), ranges([(4, 5)]), ranges([])
    ('7 to 9, 12', '4, 5', 'none')
    >>> ranges([(2, 5), (7, 7), (9, 11)], most=2)
    '2 to 5, 7 and 3 more'
    """
    there = list(stretches)
    shown = there if most is None else there[:most]
    words = []
    for first, last in shown:
        between = ", " if last == first + 1 else " to "
        words.append(str(first) if first == last else f"{first}{between}{last}")
    more = sum(last - first + 1 for first, last in there[len(shown) :])
    return (", ".join(words) or "none") + (f" and {more} more" if more else "")


def numbered(what: str, stretches: Sequence[Span], most: int | None = None) -> str:
    """The same with the noun before it.

    >>> numbered("experiment", [(3, 3)]), numbered("experiment", [(3, 4)])
    ('experiment 3', 'experiments 3, 4')
    """
    one = len(stretches) == 1 and stretches[0][0] == stretches[0][1]
    return f"{what}{'' if one else 's'} {ranges(stretches, most)}"
