"""The rotor's eccentricity and what it shakes."""

from __future__ import annotations

import math

from ldt_core.effects.base import factor_of
from ldt_core.physics.effect import Effect
from ldt_core.physics.parameter import Parameter

BISOI = (
    "Bisoi, Samantaray, Bhattacharyya, Sommerfeld Effect Characterization in Anisotropic "
    "Non-ideal Rotor System (2020)"
)


def _axes(values, name, x, y):
    return {**values, f"{name}_x": values[f"{name}_x"] * x, f"{name}_y": values[f"{name}_y"] * y}


MOST_E = 1.0  # m; no rotor's mass sits so far off its axis: it is millimetres without their unit

UNBALANCE = Effect(
    name="unbalance",
    family="foundation",
    description="the rotor's centre of mass is off its axis and shakes the foundation (Sommerfeld)",
    equation="e := e + increment",
    parameters=(
        Parameter("e", "m", 0.0, math.inf, 0.0, "increment of e", scale=0.008, meant=MOST_E),
    ),
    typical={"e": 0.008},
    search={"e": (0.001, 0.002, 0.003, 0.0045, 0.006, 0.008, 0.01, 0.013)},
    on_parameters=lambda values, e: {**values, "e": values["e"] + e},
    needs=("e",),
    reference=BISOI,
)

#: A tenth apart or less in the frequency of the resonance, which is sharp: from further away, a
#: fit ends in another minimum.
FACTORS = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.25, 1.45, 1.7, 2.0)

FOUNDATION_STIFFNESS = Effect(
    name="foundation_stiffness",
    family="foundation",
    description="foundation stiffer or softer than in the file; visible only with unbalance",
    equation="K_x := x K_x, K_y := y K_y",
    parameters=(factor_of("of K_x", "x"), factor_of("of K_y", "y")),
    typical={"x": 0.8, "y": 0.8},
    search={"x": FACTORS, "y": FACTORS},
    on_parameters=lambda values, x, y: _axes(values, "K", x, y),
    needs=("K_x", "K_y"),
    reference=BISOI,
)

FOUNDATION_DAMPING = Effect(
    name="foundation_damping",
    family="foundation",
    description="foundation damped more or less than in the file; visible only with unbalance",
    equation="R_x := x R_x, R_y := y R_y",
    parameters=(factor_of("of R_x", "x"), factor_of("of R_y", "y")),
    typical={"x": 2.0, "y": 2.0},
    search={"x": (0.4, 1.0, 2.5), "y": (0.4, 1.0, 2.5)},
    on_parameters=lambda values, x, y: _axes(values, "R", x, y),
    needs=("R_x", "R_y"),
    reference=BISOI,
)
