"""What the library's effects are made of; `Effect` itself is in `ldt_core.physics.effect`."""

from __future__ import annotations

import math

from ldt_core.physics.effect import Effect
from ldt_core.physics.parameter import Parameter, Values

__all__ = ["SMALL_VOLTAGE", "Effect", "factor_of", "scaled"]

# What depends on the direction of the current turns over the one that this voltage [V] drives
# through the winding: small next to what turns a motor, and mild enough for the step.
SMALL_VOLTAGE = 0.1


def scaled(values: Values, factor: float, *names: str) -> dict[str, float]:
    """The machine's parameters with some multiplied by a factor."""
    return {**values, **{name: values[name] * factor for name in names}}


def factor_of(description: str, name: str = "factor") -> Parameter:
    """A parameter that multiplies one of the machine's, which keeps its sign whatever it is."""
    return Parameter(name, "", 0.0, math.inf, 1.0, description, open_low=True, scale=0.3)
