"""The motor's electrical side: winding, supply, and what lies between command and terminals."""

from __future__ import annotations

import numpy as np

from ldt_core.effects.base import Effect, factor_of, scaled
from ldt_core.physics.parameter import Parameter

COPPER = 0.00393  # 1/K, temperature coefficient of the resistance of copper at 20 °C
NO_LIMIT = 1e6  # V; a supply that never saturates


def _heating(t, theta, omega, current, voltage, p, state, rate):
    resistance = p[2] * (1.0 + COPPER * state[0])
    rate[0] = (p[0] * resistance * current * current - state[0]) / p[1]
    return -p[2] * COPPER * state[0] * current


def _source(t, theta, omega, current, voltage, p):
    return -p[0] * current


def _saturated(times, volts, limit):
    return times, np.clip(volts, -limit, limit)


def _dead(times, volts, width):
    return times, np.sign(volts) * np.maximum(np.abs(volts) - width, 0.0)


def _delayed(times, volts, delay):
    return times + delay, volts


ARMATURE_RESISTANCE = Effect(
    name="armature_resistance",
    description="resistance of the winding other than in the machine file",
    equation="R := factor R",
    parameters=(factor_of("of the resistance"),),
    typical={"factor": 1.3},
    on_parameters=lambda values, factor: scaled(values, factor, "R"),
    needs=("R",),
)

MOTOR_CONSTANT = Effect(
    name="motor_constant",
    description="torque and back-EMF constant other than in the machine file (weak magnets)",
    equation="K_t := factor K_t",
    parameters=(factor_of("of the motor constant"),),
    typical={"factor": 0.9},
    on_parameters=lambda values, factor: scaled(values, factor, "K_t"),
    needs=("K_t",),
)

ARMATURE_INDUCTANCE = Effect(
    name="armature_inductance",
    description="inductance of the winding other than in the machine file",
    equation="L := factor L",
    parameters=(factor_of("of the inductance"),),
    typical={"factor": 3.0},
    on_parameters=lambda values, factor: scaled(values, factor, "L"),
    needs=("L",),
)

WINDING_HEATING = Effect(
    name="winding_heating",
    description="the winding warms with its losses, and its resistance with it; cold at the start",
    equation="R(T) = R (1 + 0.00393 T), tau T' = R_th R(T) i^2 - T",
    parameters=(
        Parameter(
            "thermal_resistance",
            "K/W",
            0.0,
            default=0.0,
            description="steady rise of temperature for each watt of loss, R_th",
            scale=3.0,
        ),
        Parameter(
            "time_constant", "s", 0.1, default=10.0, description="of warming, tau", scale=10.0
        ),
    ),
    typical={"thermal_resistance": 10.0, "time_constant": 10.0},
    terminal=_heating,
    states=("temperature_rise",),
    needs=("R",),
)

SOURCE_RESISTANCE = Effect(
    name="source_resistance",
    description="the supply's voltage falls with the current (looks like a larger armature "
    "resistance unless the voltage is measured at the terminals)",
    equation="terminal voltage = V - R_s i",
    parameters=(
        Parameter(
            "resistance", "Ohm", 0.0, default=0.0, description="of supply and leads", scale=0.2
        ),
    ),
    typical={"resistance": 0.3},
    terminal=_source,
    needs=("L",),
    fastest=lambda values, voltage, resistance: (values["R"] + resistance) / values["L"],
)

VOLTAGE_SATURATION = Effect(
    name="voltage_saturation",
    description="the supply gives no more than its limit, either way",
    equation="V := min(max(V, -limit), limit)",
    parameters=(
        Parameter(
            "limit",
            "V",
            0.0,
            NO_LIMIT,
            NO_LIMIT,
            "largest voltage; the default is none",
            open_low=True,
            scale=10.0,
        ),
    ),
    typical={"limit": 10.0},
    on_voltage=_saturated,
)

INPUT_DEADZONE = Effect(
    name="input_deadzone",
    description="the driver ignores small commands and loses as much of the others",
    equation="V := sign(V) max(|V| - width, 0)",
    parameters=(
        Parameter("width", "V", 0.0, default=0.0, description="half of the zone", scale=0.5),
    ),
    typical={"width": 0.5},
    on_voltage=_dead,
)

INPUT_DELAY = Effect(
    name="input_delay",
    description="commands arrive late; before, the voltage is what kept the first state steady",
    equation="V(t) := V(t - delay)",
    parameters=(Parameter("delay", "s", 0.0, default=0.0, description="of commands", scale=0.05),),
    typical={"delay": 0.05},
    on_voltage=_delayed,
)
