"""What a law of the challenge is: an effect as this simulator has it, and its name in a diagnosis.

Each law has departures from what the library of effects says: a bristle friction whose level falls
with the speed, a brake that saturates. `odd` scales them, and 0 leaves the library's own form in
this simulator's words, to which the key's parameters are fitted (`law_fitting.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

PHASE = "phase"  # the parameter that is an angle of a whole turn, and follows where a shaft starts

Numbers = Mapping[str, float]
Random = np.random.Generator
Draw = Callable[[Random, Numbers], dict[str, float]]
Values = Callable[[float, Numbers, Numbers], dict[str, float]]
Put = Callable[[Any, Numbers, Numbers, float], None]


@dataclass(frozen=True, eq=False)
class Law:
    """An effect with laws of this simulator's own.

    Args:
        name: of the effect, or of the outside cause.
        units: parameter of the library → its unit; empty for what is outside.
        sizes: smallest and largest size, both positive; a larger one makes a larger gap.
        draw: (random, machine's parameters) → numbers that shape the law, its departures included.
        values: (size, shape, machine's parameters) → the library's parameters.
        put: (plant, values, shape, odd) → None: writes the law into the plant.
        each: (plant, shape, number, random) → None: what changes from experiment to experiment.
        family: laws of one family would undo or hide one another, and never act together.
        needs: "" for every machine, "rotor", or "eccentric": a rotor with known unbalance.
        reversing: shows only when the machine turns both ways.
        pausing: shows only where the command is 0 at times.
        from_rest: of the library's form only where each experiment starts at rest, at one angle.
        quick: of the library's form only where the current settles within a sample or so.
        kept: parameters that are exact as they are and not fitted.
        place: (values, shape, machine's parameters) → where the law acts, if only in a region.
    """

    name: str
    units: Mapping[str, str]
    sizes: tuple[float, float]
    draw: Draw
    values: Values
    put: Put
    each: Callable[[Any, Numbers, int, Random], None] | None = None
    family: str = ""
    needs: str = ""
    reversing: bool = False
    pausing: bool = False
    from_rest: bool = False
    quick: bool = False
    kept: tuple[str, ...] = ()
    place: Callable[[Numbers, Numbers, Numbers], dict[str, Any] | None] | None = None


class Signed(NamedTuple):
    """A number of either sign whose size is between the two."""

    low: float
    high: float


EITHER = "either sign"  # 1 or -1
#: How a number is drawn: uniformly between two, of either sign, as the machine file has it (the
#: name of its parameter there), or by a function of its own.
Drawn = tuple[float, float] | Signed | str | Callable[[Random], float]


def drawn(*before: tuple[str, Drawn], **numbers: Drawn) -> Draw:
    """Numbers by name, drawn in their order.

    Args:
        before: further ones, drawn first; one of the same name takes their place.
        numbers: name → how it is drawn.
    """
    pairs = (*before, *numbers.items())
    return lambda random, known: {name: _number(how, random, known) for name, how in pairs}


def either(random: Random) -> float:
    """1 or -1."""
    return float(random.choice([-1.0, 1.0]))


def _number(how: Drawn, random: Random, known: Numbers) -> float:
    if isinstance(how, str):
        return either(random) if how == EITHER else known[how]
    if isinstance(how, Signed):
        return either(random) * float(random.uniform(*how))
    return random.uniform(*how) if isinstance(how, tuple) else how(random)


def law(
    registry: dict[str, Law],
    name: str,
    units: Mapping[str, str] | str,
    sizes: tuple[float, float],
    draw: Draw,
    values: Values | None = None,
    **more: Any,
) -> Callable[[Put], Put]:
    """Make a law of the function that writes it into the plant.

    Args:
        registry: to enter it in.
        name: see `Law`, as all others.
        units: of an outside cause, which has none, the name of its one parameter.
        sizes: of the law.
        draw: its other numbers.
        values: None for the size itself as the one parameter.
        more: fields of `Law`.
    """
    own = [units] if isinstance(units, str) else list(units)

    def size_alone(size: float, s: Numbers, known: Numbers) -> dict[str, float]:
        return {own[0]: size}

    def enter(put: Put) -> Put:
        named = {} if isinstance(units, str) else units
        registry[name] = Law(name, named, sizes, draw, values or size_alone, put, **more)
        return put

    return enter


def speeds(begin: float, end: float | None = None) -> dict[str, Any]:
    """A region of speeds [rad/s] as a place; no end for all above."""
    return {"quantity": "speed", "from": begin, "to": end, "unit": "rad/s"}
