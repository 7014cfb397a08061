"""What wears on a machine, as a person reads it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.lab.study.study_case import RunResult
from ldt_core.machine.machine_file import load_machine


@dataclass(frozen=True)
class WearQuantity:
    """What wears.

    Attributes:
        name: in words, capitalised.
        symbol: in a sentence.
        unit: after scaling.
        scale: from SI.
    """

    name: str
    symbol: str
    unit: str
    scale: float

    @property
    def label(self) -> str:
        """Of an axis."""
        unit = f" [{self.unit}]" if self.unit else ""
        return f"{self.name[0].lower()}{self.name[1:]} {self.symbol}".rstrip() + unit

    def scaled(self, values: Sequence[float]) -> Array:
        """In `unit`."""
        return np.asarray(values, dtype=np.float64) * self.scale

    def text(self, value: float) -> str:
        """One value in a sentence."""
        return f"{self.symbol} = {value * self.scale:.3g} {self.unit}".rstrip()


ECCENTRICITY = WearQuantity("Eccentricity", "e", "mm", 1e3)


def wear(result: RunResult) -> WearQuantity:
    """What wears in a run: the rotor's e in mm, anything else in its own unit."""
    try:
        entry = load_machine(result.case.machine).simulation.get("degradation", {})
    except LdtError:
        entry = {}
    if entry.get("effect", "unbalance") == "unbalance":
        return ECCENTRICITY
    return WearQuantity("Wear", str(entry.get("parameter", "")), "", 1.0)
