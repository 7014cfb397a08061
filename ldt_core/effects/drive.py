"""The motor's electrical side: winding, supply, and what lies between command and terminals."""

from __future__ import annotations

import math

import numpy as np

from ldt_core.base.compiled import njit
from ldt_core.effects.base import SMALL_VOLTAGE, Effect, factor_of, scaled
from ldt_core.physics.parameter import Parameter

COPPER = 0.00393  # 1/K, temperature coefficient of the resistance of copper at 20 °C
NO_LIMIT = 1e6  # V or A; a supply that never saturates
MOST_BRUSH_DROP = 10.0  # V, five times what carbon brushes lose (IEC 60034-2-1)
DIODE_VOLTAGE = 0.05  # V; over which a diode begins to block
# Share of the braking current below which a current fades instead of stopping at 0 at once, which
# would break the integrator's order.
FADING = 0.2
STEEPEST = 1.07  # largest slope of 1 / (1 + u^4)
LEONHARD = "Leonhard, Control of Electrical Drives"


def _heating(t, theta, omega, current, voltage, p, state, rate):
    resistance = p[2] * (1.0 + COPPER * state[0])
    rate[0] = (p[0] * resistance * current * current - state[0]) / p[1]
    return -p[2] * COPPER * state[0] * current


def _brushes(t, theta, omega, current, voltage, p):
    u = current * p[1] / SMALL_VOLTAGE
    square = u * u
    return -p[0] * u / math.sqrt(math.sqrt(1.0 + square * square))  # a third of the time of tanh


def _blocking(t, theta, omega, current, voltage, p):
    share, constant, resistance = p[0], p[1], p[2]
    back = constant * omega - voltage  # what drives a current against positive voltage
    lifted = 0.0
    if voltage >= 0.0:
        lifted += _blocked(back, current * resistance)
    if voltage <= 0.0:
        lifted -= _blocked(-back, -current * resistance)
    return share * lifted


def _open(t, theta, omega, current, voltage, p):
    if math.fabs(voltage) < SMALL_VOLTAGE:
        return p[0] * (p[1] * omega - voltage)
    return 0.0


def _saturating(t, theta, omega, current, voltage, p):
    square = current * current / (p[0] * p[0])
    return -p[1] * current * square / (1.0 + square)


def _saturated_back(t, theta, omega, current, voltage, p):
    square = current * current / (p[0] * p[0])
    return p[1] * omega * square / (1.0 + square)


def _limiting(t, theta, omega, current, voltage, p):
    back, most = p[1] * omega, p[0] * p[2]  # what the motor's speed asks for, what the limit allows
    return min(max(voltage, back - most), back + most) - voltage


@njit()
def _blocked(back, drop):  # pragma: no cover - compiled
    """How far diodes let the terminals rise above a command that would take current back [V]."""
    size = math.sqrt(back * back + DIODE_VOLTAGE * DIODE_VOLTAGE)
    if back > 0.0:
        excess = 0.5 * (back + size)
    else:
        excess = 0.5 * DIODE_VOLTAGE * DIODE_VOLTAGE / (size - back)  # without cancellation
    if drop <= 0.0:
        return excess
    u = drop / (FADING * excess)
    return excess / (1.0 + u * u * u * u)


def _saturated(times, volts, limit):
    return times, np.clip(volts, -limit, limit)


def _dead(times, volts, width):
    return times, np.sign(volts) * np.maximum(np.abs(volts) - width, 0.0)


def _delayed(times, volts, delay):
    return times + delay, volts


def _slowed(times, volts, time_constant):
    steps = np.diff(times[1:], append=2 * times[-1] - times[-2])  # the last as long as before
    if volts.size < 3 or time_constant < 1e-6 * steps[0]:  # its formula cancels there
        return times, volts
    return times, _means_behind(volts, steps, time_constant)


@njit()
def _means_behind(volts, steps, time_constant):  # pragma: no cover - compiled
    """Means over each level's time of what a filter gives that has settled at the first one."""
    means, given = volts.copy(), volts[0]
    for k in range(steps.size):
        ratio, behind = steps[k] / time_constant, given - volts[k + 1]
        means[k + 1] = volts[k + 1] - behind * math.expm1(-ratio) / ratio
        given = volts[k + 1] + behind * math.exp(-ratio)
    return means


def _amplified(times, volts, factor):
    return times, volts * factor


def _offset(times, volts, bias):
    return times, volts + bias


def _limit(name: str, unit: str, description: str, scale: float) -> Parameter:
    """A size that nothing exceeds; by default nothing reaches it."""
    return Parameter(name, unit, 0.0, NO_LIMIT, NO_LIMIT, description, open_low=True, scale=scale)


ARMATURE_RESISTANCE = Effect(
    name="armature_resistance",
    family="resistance",
    description="winding resistance that differs from the machine file",
    equation="R := factor R",
    parameters=(factor_of("of the resistance"),),
    typical={"factor": 1.3},
    on_parameters=lambda values, factor: scaled(values, factor, "R"),
    needs=("R",),
    reference=f"{LEONHARD}, chapter 5 (separately excited DC machine)",
)

MOTOR_CONSTANT = Effect(
    name="motor_constant",
    description="torque and back-EMF constant that differs from the machine file (weak magnets)",
    equation="K_t := factor K_t",
    parameters=(factor_of("of the motor constant"),),
    typical={"factor": 0.9},
    on_parameters=lambda values, factor: scaled(values, factor, "K_t"),
    needs=("K_t",),
    reference=f"{LEONHARD}, chapter 5 (the field's flux)",
)

ARMATURE_INDUCTANCE = Effect(
    name="armature_inductance",
    family="lag",
    description="winding inductance that differs from the machine file",
    equation="L := factor L",
    parameters=(factor_of("of the inductance"),),
    typical={"factor": 3.0},
    on_parameters=lambda values, factor: scaled(values, factor, "L"),
    needs=("L",),
    reference=f"{LEONHARD}, chapter 5 (separately excited DC machine)",
    most_factor=100.0,  # the file's is often a guess, since it shows little
)

WINDING_HEATING = Effect(
    name="winding_heating",
    family="resistance",
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
    search={"thermal_resistance": (1.0, 5.0, 20.0), "time_constant": (1.0, 5.0, 20.0, 100.0)},
    terminal=_heating,
    states=("temperature_rise",),
    needs=("R",),
    reference=f"{LEONHARD}, chapter 4 (thermal effects); IEC 60028 for copper",
)

SOURCE_RESISTANCE = Effect(
    name="source_resistance",
    family="resistance",
    description="the supply's voltage falls with the current (looks like a larger armature "
    "resistance unless the voltage is measured at the terminals)",
    equation="terminal voltage = V - R_s i",
    parameters=(
        Parameter(
            "resistance", "Ohm", 0.0, default=0.0, description="of supply and leads", scale=0.2
        ),
    ),
    typical={"resistance": 0.3},
    # In series with the winding, which the equations take together.
    on_parameters=lambda values, resistance: {**values, "R": values["R"] + resistance},
    needs=("R",),
    reference="Horowitz, Hill, The Art of Electronics, chapter 1 (Thévenin's source)",
)

BRUSH_DROP = Effect(
    name="brush_drop",
    family="dry friction",
    description="voltage lost at the brushes, nearly the same at every current",
    equation="terminal voltage = V - V_b sign(i), the sign smoothed over i = 0.1 V / R",
    parameters=(
        Parameter(
            *("voltage", "V", 0.0, MOST_BRUSH_DROP, 0.0, "at both brushes together, V_b"),
            scale=1.0,
        ),
    ),
    typical={"voltage": 1.0},
    terminal=_brushes,
    needs=("R", "L"),
    fastest=lambda values, _, voltage: values["R"] / values["L"] * (1.0 + voltage / SMALL_VOLTAGE),
    reference="Modelica Standard Library, Electrical.Machines.Losses.DCMachines.Brush; "
    "IEC 60034-2-1: 2 V for carbon brushes, 0.6 V for those with metal",
)

NO_REGENERATION = Effect(
    name="no_regeneration",
    description="the drive does not brake: its diodes block current against the command, and the "
    "shaft coasts down to the new speed; at a command of 0 they block both ways",
    equation="terminal voltage = V + s (K_t omega - V) where V >= 0, K_t omega > V and no current "
    "flows forward, and so backward; smoothed over 0.05 V and a fifth of the braking current",
    parameters=(
        Parameter(
            "share",
            "",
            0.0,
            1.0,
            0.0,
            "of the braking current that is blocked, s; 1 is a drive that cannot brake",
            scale=0.5,
        ),
    ),
    typical={"share": 1.0},
    terminal=_blocking,
    needs=("K_t", "R", "L"),
    fastest=lambda values, voltage, share: (
        values["R"] / values["L"] * (1.0 + STEEPEST * share / FADING)
    ),
    reference="Mohan, Undeland, Robbins, Power Electronics, chapter on DC motor drives (converters "
    "for one quadrant)",
)

OPEN_CIRCUIT = Effect(
    name="open_circuit",
    description="at a command of 0 the drive leaves the terminals open: the shaft coasts and does "
    "not brake",
    equation="terminal voltage = V + s (K_t omega - V) where |V| < 0.1 V, so that no current flows",
    parameters=(
        Parameter(
            "share", "", 0.0, 1.0, 0.0, "of the braking current that is missing, s", scale=0.5
        ),
    ),
    typical={"share": 1.0},
    terminal=_open,
    needs=("K_t",),
    reference="Mohan, Undeland, Robbins, Power Electronics, chapter on DC motor drives "
    "(freewheeling and open terminals)",
)

VOLTAGE_SATURATION = Effect(
    name="voltage_saturation",
    description="the supply limits the voltage in both directions",
    equation="V := min(max(V, -limit), limit)",
    parameters=(_limit("limit", "V", "largest voltage; the default is none", 10.0),),
    typical={"limit": 10.0},
    on_voltage=_saturated,
    reference="Khalil, Nonlinear Systems, chapter 1 (common nonlinearities: saturation)",
)

MAGNETIC_SATURATION = Effect(
    name="magnetic_saturation",
    family="torque limit",
    description="the motor constant falls with the current, as the armature weakens the field",
    equation="K_t := K_t / (1 + (i / current)^2), of torque and back-EMF",
    parameters=(_limit("current", "A", "at which the constant has fallen to half", 20.0),),
    typical={"current": 12.0},
    torque=_saturating,
    terminal=_saturated_back,
    needs=("K_t",),
    reference="Fitzgerald, Kingsley, Umans, Electric Machinery, chapter on DC machines (armature "
    "reaction)",
)

CURRENT_LIMIT = Effect(
    name="current_limit",
    family="torque limit",
    description="the drive limits the current, and so the torque, in both directions",
    equation="V := min(max(V, K_t omega - R limit), K_t omega + R limit), so that |i| <= limit",
    parameters=(_limit("limit", "A", "largest current; the default is none", 10.0),),
    typical={"limit": 6.0},
    terminal=_limiting,
    needs=("K_t", "R"),
    reference=f"{LEONHARD}, chapter on the controlled DC drive (current limit)",
)

INPUT_DEADZONE = Effect(
    name="input_deadzone",
    family="dry friction",
    description="the driver ignores small commands and reduces all others by as much",
    equation="V := sign(V) max(|V| - width, 0)",
    parameters=(
        Parameter("width", "V", 0.0, default=0.0, description="half of the zone", scale=0.5),
    ),
    typical={"width": 0.5},
    on_voltage=_dead,
    reference="Khalil, Nonlinear Systems, chapter 1 (common nonlinearities: dead zone)",
)

INPUT_GAIN = Effect(
    name="input_gain",
    family="calibration",
    description="the supply or amplifier puts out a multiple of the command (looks like a sensor's "
    "gain unless the current is measured)",
    equation="V := factor V",
    parameters=(factor_of("of the voltage"),),
    typical={"factor": 1.05},
    on_voltage=_amplified,
    reference="Mohan, Undeland, Robbins, Power Electronics, chapter on DC motor drives (gain of "
    "the converter)",
)

INPUT_BIAS = Effect(
    name="input_bias",
    family="calibration",
    description="the amplifier adds the same voltage to every command, 0 included",
    equation="V := V + bias",
    parameters=(Parameter("bias", "V", default=0.0, description="either sign", scale=0.5),),
    typical={"bias": 0.5},
    on_voltage=_offset,
    reference="Horowitz, Hill, The Art of Electronics, chapter 4 (offset of an amplifier)",
)

INPUT_DELAY = Effect(
    name="input_delay",
    family="lag",
    description="commands arrive late; until then the voltage is that of the steady start",
    equation="V(t) := V(t - delay)",
    parameters=(Parameter("delay", "s", 0.0, default=0.0, description="of commands", scale=0.05),),
    typical={"delay": 0.05},
    search={"delay": (0.01, 0.03, 0.08, 0.2)},
    on_voltage=_delayed,
    reference="Åström, Wittenmark, Computer-Controlled Systems, chapter 2 (time delay)",
)

INPUT_LAG = Effect(
    name="input_lag",
    family="lag",
    description="the drive is slow: a filter of first order (looks like a slow sensor unless the "
    "current is measured)",
    equation="tau V' = command - V, by its mean over each sample period",
    parameters=(Parameter("time_constant", "s", 0.0, default=0.0, description="tau", scale=0.05),),
    typical={"time_constant": 0.05},
    search={"time_constant": (0.01, 0.03, 0.1, 0.3)},
    on_voltage=_slowed,
    reference=f"{LEONHARD} (a converter as a lag of first order)",
)
