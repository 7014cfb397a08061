"""What the shaft carries."""

from __future__ import annotations

import math

from ldt_core.physics.effect import Effect
from ldt_core.physics.parameter import Parameter


def _constant(t, theta, omega, current, voltage, p):
    return -p[0]


def _gravity(t, theta, omega, current, voltage, p):
    return -p[0] * math.cos(theta + p[1])


def _spring(t, theta, omega, current, voltage, p):
    return -p[0] * theta


CONSTANT_LOAD = Effect(
    name="constant_load",
    description="a hoist's load: pulls against positive rotation, also at rest",
    equation="torque = -T",
    parameters=(Parameter("torque", "N m", 0.0, default=0.0, description="load T", scale=0.05),),
    typical={"torque": 0.05},
    torque=_constant,
    reference="Leonhard, Control of Electrical Drives, chapter 1 (load of a hoist)",
)

GRAVITY_IMBALANCE = Effect(
    name="gravity_imbalance",
    family="angle",
    description="an eccentric mass on a horizontal shaft, acting only by its weight",
    equation="torque = -T cos(theta + phi), T = m g e; theta counts from the experiment's start",
    parameters=(
        Parameter("torque", "N m", 0.0, default=0.0, description="amplitude T", scale=0.05),
        Parameter("phase", "rad", -math.pi, math.pi, 0.0, "at the start, phi", scale=1.0),
    ),
    typical={"torque": 0.1},
    search={"torque": (0.02, 0.1, 0.4, 1.6, 6.4)},  # up to what the motor cannot lift
    torque=_gravity,
    needs=("J",),
    fastest=lambda values, voltage, torque, phase: math.sqrt(torque / values["J"]),
    reference="Genta, Dynamics of Rotating Systems, chapter on the Jeffcott rotor (its weight)",
)

SPRING_LOAD = Effect(
    name="spring_load",
    description="a return spring, as of a valve, that is relaxed where the experiment starts",
    equation="torque = -k theta; theta counts from the experiment's start",
    parameters=(
        Parameter(
            "stiffness", "N m/rad", 0.0, default=0.0, description="of the spring, k", scale=0.05
        ),
    ),
    typical={"stiffness": 0.05},
    search={"stiffness": (0.001, 0.005, 0.02, 0.1, 0.5)},
    torque=_spring,
    needs=("J",),
    fastest=lambda values, voltage, stiffness: math.sqrt(stiffness / values["J"]),
    reference="Inman, Engineering Vibration, chapter 1 (torsional spring)",
)
