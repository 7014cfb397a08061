"""Rows of results made into what a figure draws: curves over levels and thresholds, units."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.errors import LdtError
from ldt_core.lab.study.case import Result
from ldt_core.lab.study.statistics import mean
from ldt_core.machine.machine_file import load_machine

Row = NDArray[np.float64]


@dataclass(frozen=True)
class Quantity:
    """What wears, as a person reads it.

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

    def scaled(self, values: Sequence[float]) -> Row:
        """In `unit`."""
        return np.asarray(values, dtype=np.float64) * self.scale

    def text(self, value: float) -> str:
        """One value in a sentence."""
        return f"{self.symbol} = {value * self.scale:.3g} {self.unit}".rstrip()


ECCENTRICITY = Quantity("Eccentricity", "e", "mm", 1e3)


def wear(result: Result) -> Quantity:
    """What wears in a run: the rotor's e in mm, anything else in its own unit."""
    try:
        entry = load_machine(result.case.machine).simulation.get("degradation", {})
    except LdtError:
        entry = {}
    if entry.get("effect", "unbalance") == "unbalance":
        return ECCENTRICITY
    return Quantity("Wear", str(entry.get("parameter", "")), "", 1.0)


@dataclass(frozen=True)
class Curve:
    """A quantity over a grid, with its mean and interval over the seeds at each point.

    Attributes:
        x: (n,) grid.
        mean: (n,)
        low: (n,) of the 95 % confidence interval of the mean; the mean where one seed is there.
        high: (n,)
    """

    x: Row
    mean: Row
    low: Row
    high: Row

    @classmethod
    def over_seeds(cls, x: Sequence[float], values: Iterable[Sequence[float]]) -> Curve:
        """From one row of values a grid point."""
        found = [mean(v) for v in values]
        middle = np.array([e.value for e in found], dtype=np.float64)
        low = np.array([e.low if np.isfinite(e.low) else e.value for e in found], dtype=float)
        high = np.array([e.high if np.isfinite(e.high) else e.value for e in found], dtype=float)
        return cls(np.asarray(x, dtype=np.float64), middle, low, high)


def first_seed(results: Sequence[Result]) -> int:
    """The seed that a figure of a single stream shows: the smallest."""
    return min(r.case.seed for r in results)


def of_seed(results: Iterable[Result], seed: int) -> list[Result]:
    """Those of one seed."""
    return [r for r in results if r.case.seed == seed]


def by_level(
    results: Sequence[Result], value: Callable[[Result, NDArray[np.bool_]], float]
) -> Curve:
    """A figure of merit for each level of what wears, over the seeds.

    Args:
        results: one a seed.
        value: of a run, in the experiments that a mask over its rows picks.
    """
    levels = sorted({round(v, 9) for r in results for v in r.truth})
    rows = []
    for level in levels:
        masks = [(r, np.isclose(r.truth, level, atol=1e-9)) for r in results]
        rows.append([value(r, mask) for r, mask in masks if mask.any()])
    return Curve.over_seeds(levels, rows)
