"""What a law of the challenge is: an effect as this simulator has it, and its name in a diagnosis.

Each law has departures from what the library of effects says: a bristle friction whose level falls
with the speed, a brake that saturates. `odd` scales them, and 0 leaves the library's own form in
this simulator's words, to which the key's parameters are fitted (`nearest.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

Numbers = Mapping[str, float]
Random = np.random.Generator


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
        kept: parameters that are exact as they are and not fitted.
        place: (values, shape, machine's parameters) → where the law acts, if only in a region.
    """

    name: str
    units: Mapping[str, str]
    sizes: tuple[float, float]
    draw: Callable[[Random, Numbers], dict[str, float]]
    values: Callable[[float, Numbers, Numbers], dict[str, float]]
    put: Callable[[Any, Numbers, Numbers, float], None]
    each: Callable[[Any, Numbers, int, Random], None] | None = None
    family: str = ""
    needs: str = ""
    reversing: bool = False
    kept: tuple[str, ...] = ()
    place: Callable[[Numbers, Numbers, Numbers], dict[str, Any] | None] | None = None

    @property
    def outside(self) -> bool:
        """Whether no effect of the library is its name."""
        return not self.units


def either(random: Random) -> float:
    """1 or -1."""
    return float(random.choice([-1.0, 1.0]))


def signed(random: Random, low: float, high: float) -> float:
    """A number of either sign whose size is between the two."""
    return either(random) * float(random.uniform(low, high))
