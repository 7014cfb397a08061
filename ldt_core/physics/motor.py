"""A DC motor with a rigid load: `dc_motor`.

    J omega' = K_t i - b omega
    L i'     = V - R i - K_t omega

States: theta [rad], omega [rad/s], current [A].
"""

from __future__ import annotations

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.physics.motor_driven import MotorDriven
from ldt_core.physics.motor_rates import inductance, motor_rate
from ldt_core.physics.parameter import Parameter, Values
from ldt_core.physics.run_plan import Constants

#: Relative standard deviation of what a data sheet states: makers of small motors promise 10 %,
#: which is taken for two deviations.
STATED = 0.05
#: The same of friction and damping, which nobody states and which change with temperature.
GUESSED = 0.2
MOTOR_TOLERANCES = {"J": STATED, "K_t": STATED, "R": STATED, "L": 2 * STATED, "b": GUESSED}
MOTOR_PARAMETERS = (
    Parameter("J", "kg m^2", 0.0, open_low=True, description="moment of inertia about the shaft"),
    Parameter(
        "K_t", "N m/A", 0.0, open_low=True, description="torque constant = back-EMF constant"
    ),
    Parameter("R", "Ohm", 0.0, open_low=True, description="armature resistance"),
    Parameter("L", "H", 0.0, relative=True, description="armature inductance; 0 for none"),
    Parameter("b", "N m s", 0.0, description="viscous friction of the shaft"),
)


class Motor(MotorDriven):
    """The motor alone; always linear."""

    name = "dc_motor"
    parameters = MOTOR_PARAMETERS
    tolerances = MOTOR_TOLERANCES
    states = ("theta", "omega", "current")

    def is_linear(self, values: Values) -> bool:
        """Always."""
        return True

    def constants(self, values: Values) -> Constants:
        """The rotor's equations without an eccentric mass; the foundation's numbers are unused."""
        motor = (values["K_t"], values["b"], values["R"], inductance(values), values["J"])
        return Constants(*motor, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def rate(self, values: Values, voltage: float) -> float:
        """The faster of the motor's two modes [1/s]."""
        return motor_rate(values)

    def system(self, values: Values) -> tuple[Array, Array]:
        """A (3, 3), B (3,)."""
        return motor_system(values, 3)


def motor_system(values: Values, n: int) -> tuple[Array, Array]:
    """The motor in the first three of n states: A (n, n), B (n,)."""
    k, r, j, b = (values[name] for name in ("K_t", "R", "J", "b"))
    own = inductance(values)
    a = np.zeros((n, n))
    a[0, 1] = 1.0
    a[1, 1:3] = -b / j, k / j
    a[2, 1:3] = -k / own, -r / own
    drive = np.zeros(n)
    drive[2] = 1 / own
    return a, drive


MOTOR = Motor()
