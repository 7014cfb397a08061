"""The coordinates in which parameters are fitted: relative, bounded, with a known start.

A parameter that must be above 0 is fitted as its logarithm, so that a step of 0.01 is one per cent
of it and products of parameters are sums. One that may be 0 (a friction, an eccentricity) is fitted
as a multiple of its size.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.physics.parameter import Parameter

SEARCH_FACTOR = 1000.0  # either way from the start: beyond three decades it is no calibration
LEAST_SIZE = 0.1  # of its scale: a parameter that may be 0 counts as at least this large
ON_BOUND = 1e-4  # of a coordinate: nearer than this to its bound, a parameter has ended there


@dataclass(frozen=True)
class Coordinate:
    """One free parameter, the machine file's value of it, and the value that counts as 1.

    The last is the nominal one, or a typical one where that is 0.
    """

    parameter: Parameter
    nominal: float
    scale: float

    @property
    def name(self) -> str:
        """Of the parameter."""
        return self.parameter.name

    @property
    def logarithmic(self) -> bool:
        """Whether 0 is excluded, so that the logarithm exists."""
        known = self.parameter.relative and self.nominal > 0
        return (self.parameter.open_low or known) and self.parameter.low >= 0

    def value(self, z: float) -> float:
        """The parameter at a coordinate, never outside its physical bounds."""
        value = self.scale * (math.exp(z) if self.logarithmic else z)
        return min(max(value, self.parameter.low), self.parameter.high)

    def at(self, value: float) -> float:
        """The coordinate of a parameter's value."""
        return math.log(value / self.scale) if self.logarithmic else value / self.scale

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest coordinate: what physics allows, within the range of the search."""
        if self.logarithmic:
            high = self.parameter.high
            return -math.log(SEARCH_FACTOR), min(
                math.log(SEARCH_FACTOR), math.inf if math.isinf(high) else self.at(high)
            )
        return max(self.parameter.low / self.scale, -SEARCH_FACTOR), min(
            self.parameter.high / self.scale, SEARCH_FACTOR
        )


class Coordinates:
    """The free parameters of a fit, in order, with all others of the machine at their `values`."""

    def __init__(self, free: Sequence[Coordinate], values: Mapping[str, float]) -> None:
        self.free, self.fixed = tuple(free), dict(values)

    def __len__(self) -> int:
        return len(self.free)

    @property
    def names(self) -> list[str]:
        """Of the free parameters."""
        return [c.name for c in self.free]

    @property
    def nominal(self) -> Array:
        """(p,) coordinates of the machine file's values."""
        return np.array(
            [c.at(c.nominal) if c.nominal or not c.logarithmic else 0.0 for c in self.free]
        )

    @property
    def bounds(self) -> tuple[Array, Array]:
        """(p,) lowest and (p,) highest coordinates."""
        low, high = zip(*(c.bounds for c in self.free), strict=True)
        return np.array(low), np.array(high)

    def values(self, z: Array) -> dict[str, float]:
        """All parameters of the machine at coordinates (p,)."""
        return {
            **self.fixed,
            **{c.name: c.value(float(v)) for c, v in zip(self.free, z, strict=True)},
        }

    def at(self, values: Mapping[str, float]) -> Array:
        """(p,) coordinates of parameter values."""
        return np.array([c.at(values[c.name]) for c in self.free])

    def sizes(self, z: Array) -> Array:
        """(p,) change of each coordinate that is a change of its parameter by its own size."""
        return np.array(
            [
                1.0 if c.logarithmic else max(abs(v), LEAST_SIZE)
                for c, v in zip(self.free, z, strict=True)
            ]
        )

    def inside(self, z: Array) -> Array:
        """(p,) the nearest coordinates within the bounds."""
        return np.clip(z, *self.bounds)

    def snapped(self, z: Array) -> Array:
        """(p,) the same, on the bound where it is nearer than a fit can tell."""
        low, high = self.bounds
        return np.where(z - low < ON_BOUND, low, np.where(high - z < ON_BOUND, high, z))

    def on_bound(self, z: Array) -> list[Coordinate]:
        """Those that lie on a bound; z (p,) as `snapped` gives it."""
        low, high = self.bounds
        return [c for c, v, a, b in zip(self.free, z, low, high, strict=True) if v in (a, b)]
