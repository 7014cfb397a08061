"""An effect as a candidate: the coordinates of its fit, and the values a search begins with."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.physics.effect import Effect
from ldt_core.physics.machine_sizes import LIMITS, in_own_sizes, is_limit
from ldt_core.physics.parameter import LARGEST, Parameter, logarithmic

# Where searches begin: close enough to each other that a fit gets from one to the next.
START_FACTORS = (0.4, 0.7, 0.9, 1.1, 1.4, 2.5)  # of a parameter that multiplies the machine's
START_SIZES = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 70.0)  # of a parameter's scale
START_SHAPES = (0.3, 1.0, 3.0)  # of the default of a shape, such as a time constant
START_PHASES = 8  # of a turn
MOST_STARTS = 128  # of one effect: bounds the time that it takes
DIFFERENCE_STEP = 1e-3  # of a coordinate: far above rounding, far below any curvature
# How far a fit may go.
LEAST_LIMIT = 0.05  # of the largest voltage or current: a lower one would have stopped the machine
LEAST_FACTOR = 0.05  # a machine further below its file than that is another machine
WHOLE = 1.0  # a share's end, which a machine may reach; other upper ends are where a search ends
LIMIT_MARGIN = 1e-3  # of a coordinate: nearer to its limit, a fit has ended there


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect that may explain the gap.

    Parameters are fitted as z = (value - neutral) / scale; those that multiply one of the machine's
    and the limits as z = log(value / neutral), as are those that must be above 0.

    Args:
        most: unit to the largest voltage and current of the recordings, see `most_of`.
        sizes: unit to the size of this machine's quantities, see `machine_scales`.
        details: how many of its parameters, the last ones, are details of the law.
    """

    effect: Effect
    most: Mapping[str, float]
    sizes: Mapping[str, float] = field(default_factory=dict)
    details: int = 0

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.effect.name

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Of the effect."""
        return self.effect.parameters

    def __len__(self) -> int:
        return len(self.effect.parameters)

    #: Whether all that a fit may try moves the residuals in proportion.
    steady = False

    @property
    def detailed(self) -> Candidate | None:
        """The same law in more detail, whose first coordinates are this one's; none of a law that
        has detail already: a finer one has no name in a diagnosis.
        """
        more = self.effect.detailed
        if more is None or self.details:
            return None
        return replace(self, effect=more, details=len(more.parameters) - len(self))

    def details_at(self, shape: float) -> Array:
        """(details,) coordinates of a detailed law's details, so many times their defaults."""
        begin = len(self) - self.details
        return np.array(
            [
                self.coordinate(j, min(max((p.default or 0.0) * shape, p.low), p.high))
                for j, p in enumerate(self.parameters[begin:], begin)
            ]
        )

    @property
    def differences(self) -> Array:
        """(d,) steps of the coordinates for difference quotients."""
        return np.full(len(self), DIFFERENCE_STEP)

    def scale(self, j: int) -> float:
        """Typical size of parameter j on this machine."""
        p = self.parameters[j]
        return (p.scale or 1.0) * self.sizes.get(p.unit, 1.0)

    def neutral(self, j: int) -> float:
        """Parameter j where a fit's coordinate is 0."""
        p = self.parameters[j]
        own = self.sizes.get(p.unit, 1.0) if logarithmic(p) and not is_limit(p) else 1.0
        return (p.default or 0.0) * own

    @property
    def typical(self) -> dict[str, float]:
        """The effect plainly there, in this machine's sizes."""
        given = in_own_sizes(self.effect, self.effect.typical, self.sizes)
        limits = {p.name: self.sizes.get(p.unit, 1.0) for p in self.parameters if is_limit(p)}
        return self.effect.check({n: v * limits.get(n, 1.0) for n, v in given.items()})

    def value(self, j: int, z: float) -> float:
        """Parameter j at a coordinate, within its bounds and of a size that an effect accepts."""
        p, (neutral, scale, least, as_log) = self.parameters[j], self._numbers[j]
        value = neutral * math.exp(z) if as_log else neutral + z * scale
        if p.cyclic and not p.low <= value <= p.high:
            return p.low + (value - p.low) % (2 * math.pi)
        return min(max(value, least, -LARGEST), p.high, LARGEST)

    @functools.cached_property
    def _numbers(self) -> list[tuple[float, float, float, bool]]:
        """Of each parameter, asked for at every point of a fit: what `value` computes with."""
        scales = [self.scale(j) for j in range(len(self.parameters))]
        return [
            (self.neutral(j), scale, p.least(scale), logarithmic(p))
            for j, (p, scale) in enumerate(zip(self.parameters, scales, strict=True))
        ]

    def given(self, z: Sequence[float] | Array) -> dict[str, float]:
        """All parameters at (d,) coordinates."""
        return {p.name: self.value(j, float(z[j])) for j, p in enumerate(self.parameters)}

    def coordinate(self, j: int, value: float) -> float:
        """Of a value of parameter j."""
        p, neutral = self.parameters[j], self.neutral(j)
        return math.log(value / neutral) if logarithmic(p) else (value - neutral) / self.scale(j)

    def coordinates(self, given: Mapping[str, float]) -> Array:
        """(d,) coordinates of all parameters' values."""
        return np.array([self.coordinate(j, given[p.name]) for j, p in enumerate(self.parameters)])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """(d,) lowest and (d,) highest coordinates."""
        low, high = [], []
        for j, p in enumerate(self.parameters):
            if p.cyclic:  # a fit must get from one end of the range to the other
                low.append(-math.inf)
                high.append(math.inf)
            elif logarithmic(p):
                most = self.effect.most_factor
                limit = 1 / most if p.unit else LEAST_FACTOR
                if is_limit(p) and p.default:
                    limit = LEAST_LIMIT * self.most[p.unit] / p.default
                low.append(math.log(limit))
                high.append(self.coordinate(j, p.high) if p.high < math.inf else math.log(most))
            else:
                s = self.scale(j)
                low.append((p.least(s) - (p.default or 0.0)) / s)
                high.append((p.high - (p.default or 0.0)) / s)
        return np.array(low), np.array(high)

    def at_limit(self, z: Array) -> list[str]:
        """Parameters that ended where the search does, and not the physics.

        A friction of 0 or a share of 1 is a machine; a factor that would go on growing is none.
        """
        low, high = self.bounds
        found = []
        for j, p in enumerate(self.parameters):
            near = LIMIT_MARGIN * max(1.0, min(high[j] - low[j], 1.0))
            sought_up_to = p.high < math.inf and p.high != WHOLE and not p.cyclic
            if (
                (logarithmic(p) and min(z[j] - low[j], high[j] - z[j]) <= near)
                or (0 < p.low < (p.default or 0.0) and z[j] - low[j] <= near)
                or (sought_up_to and high[j] - z[j] <= near)
            ):
                found.append(p.name)
        return found

    def scaled(self, z: Array, scale: float) -> Array:
        """Coordinates at which the effect is so many times as strong, as far as one can tell.

        By what its first parameter adds to the machine's. A limit has no such measure: the effect
        is absent where it is infinite.
        """
        if is_limit(self.parameters[0]):
            return z
        low, high = self.bounds
        none, stronger = self.neutral(0), z.copy()
        value = none + scale * (self.value(0, float(z[0])) - none)
        least = self.value(0, float(low[0]))
        stronger[0] = min(max(self.coordinate(0, max(value, least)), low[0]), high[0])
        return stronger

    def starts(self) -> list[Array]:
        """Coordinates that a search begins with, over the parameters' plausible ranges."""
        levels = [self.effect.search.get(p.name) or _levels(p, self.most) for p in self.parameters]
        found = []
        for values in itertools.product(*levels):
            levels_here = dict(zip((p.name for p in self.parameters), values, strict=True))
            given = in_own_sizes(self.effect, levels_here, self.sizes)
            if given != self.effect.neutral:
                found.append(self.coordinates(given))
        if len(found) > MOST_STARTS:
            found = found[:: math.ceil(len(found) / MOST_STARTS)]
        return found


def _levels(p: Parameter, most: Mapping[str, float]) -> list[float]:
    default, scale = float(p.default or 0.0), p.scale or 1.0
    if is_limit(p):
        return [part * most[p.unit] for part in LIMITS[p.unit]]  # already this machine's
    if logarithmic(p):
        return [default * f for f in START_FACTORS]
    if math.isfinite(p.low) and math.isfinite(p.high) and p.low < default < p.high:
        return [float(v) for v in np.linspace(p.low, p.high, START_PHASES, endpoint=False)]
    if default > p.low and p.low >= 0:  # a shape, such as a time constant
        return [max(default * f, p.low) for f in START_SHAPES if default * f <= p.high]
    up = [default + s * scale for s in START_SIZES]
    down = [default - s * scale for s in START_SIZES]
    return [v for v in down + up if p.accepts(v)]
