"""The parameters of effects as a fit moves them: from neutral, in units of their scale."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.effects import sizes_of
from ldt_core.physics.effect import Effect
from ldt_core.physics.machine_sizes import in_own_sizes, machine_scales
from ldt_core.physics.parameter import Values

Use = list[tuple[Effect, dict[str, float]]]


class EffectCoordinates:
    """One coordinate for each parameter of some effects: (value - neutral) / scale, in its bounds.

    Args:
        effects: whose parameters are unknown.
        values: the machine's parameters; an effect's scales are those of a machine of its size.
        most_voltage: that the machine is given at most [V].

    Attributes:
        parameters: of all effects, in the order of their coordinates.
        scale, low, high: (d,) of each.
    """

    def __init__(self, effects: Sequence[Effect], values: Values, most_voltage: float) -> None:
        self.effects = tuple(effects)
        self.parameters = [p for e in effects for p in e.parameters]
        self._sizes = machine_scales(values, most_voltage)
        self._neutral = np.array([v for e in effects for v in e.neutral.values()])
        scales = [
            (p.scale or 1.0) * sizes_of(e, self._sizes).get(p.unit, 1.0)
            for e in effects
            for p in e.parameters
        ]
        least = [p.least(s) for p, s in zip(self.parameters, scales, strict=True)]
        self.scale = np.array(scales)
        self._least, self._most = np.array(least), np.array([p.high for p in self.parameters])
        self.low = (self._least - self._neutral) / self.scale
        self.high = (self._most - self._neutral) / self.scale

    def __len__(self) -> int:
        return len(self.parameters)

    def given(self, z: Array) -> Use:
        """The effects with all their values at coordinates (d,), within the bounds."""
        values = np.clip(self._neutral + z * self.scale, self._least, self._most)
        found = iter(values.tolist())
        return [(e, {p.name: next(found) for p in e.parameters}) for e in self.effects]

    def at(self, given: Mapping[str, Mapping[str, float]]) -> Array:
        """(d,) coordinates of effects, each with all its values."""
        values = [given[e.name][p.name] for e in self.effects for p in e.parameters]
        return (np.array(values) - self._neutral) / self.scale

    def sized(self, effect: Effect, given: Mapping[str, float]) -> dict[str, float]:
        """All values of an effect, given in the library's sizes, in the machine's."""
        return effect.check(in_own_sizes(effect, given, sizes_of(effect, self._sizes)))
