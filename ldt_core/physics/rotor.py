"""A DC motor that turns an eccentric rotor on an elastic foundation: `dc_motor_rotor`.

    (M+m) x'' + R_x x' + K_x x = m e ( theta'' sin theta + theta'^2 cos theta)
    (M+m) y'' + R_y y' + K_y y = m e (-theta'' cos theta + theta'^2 sin theta)
    (J + m e^2) theta'' = K_t i - b theta' + m e (x'' sin theta - y'' cos theta) - m g e cos theta
    L i' = V - R i - K_t theta'

States: theta [rad], omega [rad/s], current [A], x [m], vx [m/s], y [m], vy [m/s]. Near a critical
speed of the foundation the motor's power goes into vibration and the speed is captured (Sommerfeld
effect): Bisoi, Samantaray, Bhattacharyya, "Sommerfeld Effect Characterization in Anisotropic
Non-ideal Rotor System" (2020).
"""

from __future__ import annotations

import cmath

from ldt_core.base.arrays import Array
from ldt_core.physics.motor import (
    GUESSED,
    MOTOR_PARAMETERS,
    MOTOR_TOLERANCES,
    STATED,
    motor_system,
)
from ldt_core.physics.motor_driven import MotorDriven
from ldt_core.physics.motor_rates import fastest_root, inductance, motor_rate
from ldt_core.physics.parameter import Parameter, Values
from ldt_core.physics.run_plan import Constants

STEPS_PER_RADIAN = 4  # the unbalance force turns with the shaft: 25 steps a turn, error below 1e-4


class Rotor(MotorDriven):
    """Motor, eccentric rotor and foundation; linear when the eccentricity is 0."""

    name = "dc_motor_rotor"
    parameters = (
        Parameter("m", "kg", 0.0, open_low=True, description="mass of the rotor"),
        Parameter("M", "kg", 0.0, open_low=True, description="mass of the foundation"),
        Parameter("K_x", "N/m", 0.0, open_low=True, description="stiffness of the foundation in x"),
        Parameter("K_y", "N/m", 0.0, open_low=True, description="stiffness of the foundation in y"),
        Parameter("R_x", "N s/m", 0.0, description="damping of the foundation in x"),
        Parameter("R_y", "N s/m", 0.0, description="damping of the foundation in y"),
        Parameter("e", "m", 0.0, default=0.0, description="eccentricity of the rotor"),
        *MOTOR_PARAMETERS,
        Parameter("g", "m/s^2", 0.0, default=0.0, description="gravity across the shaft"),
    )
    states = ("theta", "omega", "current", "x", "vx", "y", "vy")
    tolerances = (
        MOTOR_TOLERANCES
        | dict.fromkeys(("m", "M", "K_x", "K_y"), STATED)
        | dict.fromkeys(("R_x", "R_y"), GUESSED)
    )

    def is_linear(self, values: Values) -> bool:
        """Without eccentricity the foundation does not feel the rotor, nor gravity."""
        return values["e"] == 0

    def constants(self, values: Values) -> Constants:
        """As named in `Constants`."""
        v = values
        unbalance = v["m"] * v["e"]
        mass = v["M"] + v["m"]
        inertia = v["J"] + unbalance * v["e"] - unbalance**2 / mass
        return Constants(
            *(v["K_t"], v["b"], v["R"], inductance(v), inertia, unbalance, mass),
            *(v["K_x"], v["K_y"], v["R_x"], v["R_y"], unbalance * v["g"]),
        )

    def rate(self, values: Values, voltage: float) -> float:
        """The fastest of motor, foundation and, with an eccentricity, the turning force [1/s]."""
        mass = values["M"] + values["m"]
        rates = [motor_rate(values)]
        rates += [fastest_root(values[f"R_{a}"] / mass, values[f"K_{a}"] / mass) for a in "xy"]
        if values["e"] > 0:
            rates.append(STEPS_PER_RADIAN * abs(voltage) / values["K_t"])
        return max(rates)

    def system(self, values: Values) -> tuple[Array, Array]:
        """A (7, 7), B (7,) for e = 0."""
        a, drive = motor_system(values, 7)
        mass = values["M"] + values["m"]
        for axis, i in (("x", 3), ("y", 5)):
            a[i, i + 1] = 1.0
            a[i + 1, i] = -values[f"K_{axis}"] / mass
            a[i + 1, i + 1] = -values[f"R_{axis}"] / mass
        return a, drive

    def running_state(
        self, values: Values, speed: float, angle: float, current: float | None = None
    ) -> Array:
        """The foundation moves as the unbalance force of a constant speed makes it move."""
        state = super().running_state(values, speed, angle, current)
        mass, turn = values["M"] + values["m"], cmath.exp(1j * angle)
        for axis, i, phase in (("x", 3, 1), ("y", 5, -1j)):
            stiffness = values[f"K_{axis}"] - mass * speed**2 + 1j * values[f"R_{axis}"] * speed
            if stiffness != 0:  # without damping, at the critical speed itself, there is no limit
                motion = phase * turn * values["m"] * values["e"] * speed**2 / stiffness
                state[i], state[i + 1] = motion.real, (1j * speed * motion).real
        return state


ROTOR = Rotor()
