"""Friction and drag on the shaft."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from ldt_core.base.compiled import njit
from ldt_core.effects.base import SMALL_VOLTAGE, Effect
from ldt_core.physics.parameter import SMALLEST, Parameter, Values

# Dry friction turns its sign over this speed [rad/s], or over what it takes off in this time [s]
# where that is less: 1e-3 rad/s for a turntable that it stops in a second. A jump at 0 would break
# the integrator's order. A shaft that sticks creeps at a fraction of that speed instead, below any
# sensor's noise. The time is the coarse step of a twin's search, which would take shorter ones for
# a sharper sign, and find less in the steps that it is granted: with an eighth of it, 39 % is
# left of the stream `e_and_friction` in place of 20 %.
STICK_SPEED, STICK_TIME = 0.02, 2e-3
# Widths of the sign over which an excess at standstill fades, at least: less is told as the sign's.
TOLD_APART = 5.0
# Fastest rate at which bristles bend [1/s]. A shaft that turns by `presliding` in less than a
# millisecond bends them faster than a drive samples, and an integrator would follow what nobody
# sees: at 200 rad/s, steps of a tenth of a millisecond. A start from rest takes many times longer.
BENDING_RATE = 1000.0
SURVEY = (
    "Armstrong-Hélouvry, Dupont, Canudas de Wit, A survey of models, analysis tools and "
    "compensation methods for the control of machines with friction, Automatica 30 (1994) 1083"
)


@njit()
def _width(level, inertia):  # pragma: no cover - compiled
    """Speed over which friction of this size near standstill [N m] turns its sign [rad/s]."""
    return min(STICK_SPEED, max(level, SMALLEST) / inertia * STICK_TIME)


@njit()
def _fading(omega, velocity, width):  # pragma: no cover - compiled
    """How much is left of an excess at standstill, which fades no faster than the sign turns."""
    return math.exp(-((omega / max(velocity, TOLD_APART * width)) ** 2))


def _coulomb(t, theta, omega, current, voltage, p):
    return -p[0] * math.tanh(omega / _width(p[0], p[1]))


def _stribeck(t, theta, omega, current, voltage, p):
    width = _width(p[0] + p[1], p[3])
    return -(p[0] + p[1] * _fading(omega, p[2], width)) * math.tanh(omega / width)


def _asymmetric(t, theta, omega, current, voltage, p):
    sign = math.tanh(omega / _width(max(p[0], p[1]), p[2]))
    return -0.5 * (p[0] + p[1] + (p[0] - p[1]) * sign) * sign


def _viscous_asymmetric(t, theta, omega, current, voltage, p):
    return -0.5 * ((p[0] + p[1]) * omega + (p[0] - p[1]) * math.fabs(omega))


def _gear(t, theta, omega, current, voltage, p):
    small = SMALL_VOLTAGE / p[3]
    size = current * current / math.sqrt(current * current + small * small)
    level = p[0] * p[2] * size
    return -level * math.tanh(omega / _width(level, p[1]))


# The same laws of bristles, which bend before they slip: p holds `presliding` after the law's own.


@njit()
def _bending(omega, bent, presliding):  # pragma: no cover - compiled
    """How fast the bristles bend [rad/s]."""
    over = omega / (presliding * BENDING_RATE)
    turning = omega / math.sqrt(1.0 + over * over)
    return turning - math.fabs(turning) * bent / presliding


def _elastic_coulomb(t, theta, omega, current, voltage, p, state, rate):
    rate[0] = _bending(omega, state[0], p[1])
    return -p[0] * state[0] / p[1]


def _elastic_asymmetric(t, theta, omega, current, voltage, p, state, rate):
    rate[0] = _bending(omega, state[0], p[2])
    sign = math.tanh(omega / _width(max(p[0], p[1]), p[3]))
    level = 0.5 * (p[0] + p[1] + (p[0] - p[1]) * sign)
    return -level * state[0] / p[2]


def _elastic_gear(t, theta, omega, current, voltage, p, state, rate):
    rate[0] = _bending(omega, state[0], p[1])
    small = SMALL_VOLTAGE / p[4]
    size = current * current / math.sqrt(current * current + small * small)
    return -p[0] * p[3] * size * state[0] / p[1]


def _elastic_stribeck(t, theta, omega, current, voltage, p, state, rate):
    rate[0] = _bending(omega, state[0], p[3])
    level = p[0] + p[1] * _fading(omega, p[2], _width(p[0] + p[1], p[4]))
    return -level * state[0] / p[3]


def _changing_coulomb(t, theta, omega, current, voltage, p, state, rate):
    rate[0] = _bending(omega, state[0], p[1])
    level = p[0] * (1.0 + p[2] * _fading(omega, p[3], _width(p[0], p[4])))
    return -level * state[0] / p[1]


def _dry(plain: Effect, bristles: Callable[..., float], most: Callable[..., float]) -> Effect:
    """A law that turns its sign at once, and in detail with friction that builds up over a turn.

    Args:
        plain: the law, without `fastest`.
        bristles: the torque in detail.
        most: (values, voltage, **p) -> the largest torque [N m].
    """

    def turning(values: Values, voltage: float, **given: float) -> float:
        brakes = most(values, voltage, **given) / values["J"]
        return max(brakes / STICK_SPEED, 1 / STICK_TIME) if brakes > 0 else 0.0

    def bending(values: Values, voltage: float, presliding: float, **given: float) -> float:
        brakes = most(values, voltage, **given) / values["J"]
        top = voltage / values["K_t"]
        return max(math.sqrt(brakes / presliding), min(top / presliding, BENDING_RATE))

    presliding = Parameter(
        "presliding",
        "rad",
        1e-3,
        3.0,
        0.02,
        "turn over which the friction builds up after a reversal",
        scale=0.02,
    )
    detailed = replace(
        plain,
        description=f"{plain.description}; it builds up over a small turn (presliding)",
        equation=f"{plain.equation}; with presliding z / presliding in place of sign(omega), "
        "z' = omega - |omega| z / presliding, at most at 1000 / s",
        parameters=(*plain.parameters, presliding),
        torque=bristles,
        states=("deflection",),
        needs=("J", "K_t", *(n for n in plain.needs if n not in ("J", "K_t"))),
        fastest=bending,
        reference="Canudas de Wit, Olsson, Åström, Lischinsky, A new model for control of systems "
        "with friction, IEEE Transactions on Automatic Control 40 (1995) 419; Dahl's, undamped",
    )
    return replace(plain, fastest=turning, detailed=detailed)


def _of_changing_level(plain: Effect, torque: Callable[..., float]) -> Effect:
    """The law of bristles, and in more detail with a level that falls or rises with the speed.

    Args:
        plain: the law, with bristles in detail.
        torque: the function of both.
    """
    elastic = plain.detailed
    assert elastic is not None

    def fastest(
        values: Values, voltage: float, change: float, velocity: float, **given: float
    ) -> float:
        return elastic.rate(values, voltage, given) * max(1.0, 1.0 + change)

    change = Parameter(
        "change",
        "",
        -1.0,
        default=0.0,
        description="of the torque near standstill, as a part of that at high speed",
        scale=0.3,
    )
    velocity = Parameter(
        "velocity",
        "rad/s",
        1e-3,  # as of Stribeck friction
        default=5.0,
        description="speed over which the change fades",
        scale=5.0,
    )
    finer = replace(
        elastic,
        description=f"{elastic.description}; near standstill it is larger or smaller",
        equation=f"{elastic.equation}; times 1 + change exp(-(omega / velocity)^2)",
        parameters=(*elastic.parameters, change, velocity),
        torque=torque,
        fastest=fastest,
        search={
            "presliding": (0.02, 0.1),
            "change": (-0.3, 0.3),
            "velocity": (1.0, 4.0, 15.0),
        },
        reference=f"{elastic.reference}. {SURVEY}; rising levels: Bar-Sinai, Spatschek, Brener, "
        "Bouchbinder, On the velocity-strengthening behavior of dry friction, Journal of "
        "Geophysical Research: Solid Earth 119 (2014) 1738",
    )
    return replace(plain, detailed=replace(elastic, detailed=finer))


def _quadratic(t, theta, omega, current, voltage, p):
    return -p[0] * omega * abs(omega)


def _viscous(values, b):
    return {**values, "b": values["b"] + b}


COULOMB_FRICTION = Effect(
    name="coulomb_friction",
    family="dry friction",
    description="dry friction of the same size at every speed",
    equation="torque = -T sign(omega), the sign smoothed over 0.02 rad/s, or over "
    "T / J 2 ms where that is less",
    parameters=(
        Parameter("torque", "N m", 0.0, default=0.0, description="friction torque T", scale=0.05),
    ),
    typical={"torque": 0.05},
    torque=_coulomb,
    needs=("J",),
    reference=SURVEY,
)
COULOMB_FRICTION = _dry(COULOMB_FRICTION, _elastic_coulomb, lambda values, voltage, torque: torque)
COULOMB_FRICTION = _of_changing_level(COULOMB_FRICTION, _changing_coulomb)

ASYMMETRIC_FRICTION = Effect(
    name="asymmetric_friction",
    family="dry friction",
    description="dry friction that differs forward and backward (a worn bearing, a worm gear)",
    equation="torque = -T_f for omega > 0, +T_b for omega < 0, smoothed as Coulomb friction",
    parameters=(
        Parameter(
            "torque_forward", "N m", 0.0, default=0.0, description="for omega > 0, T_f", scale=0.05
        ),
        Parameter(
            "torque_backward", "N m", 0.0, default=0.0, description="for omega < 0, T_b", scale=0.05
        ),
    ),
    typical={"torque_forward": 0.1, "torque_backward": 0.05},
    torque=_asymmetric,
    needs=("J",),
    reference=f"{SURVEY} (levels that depend on the direction)",
)
ASYMMETRIC_FRICTION = _dry(
    ASYMMETRIC_FRICTION,
    _elastic_asymmetric,
    lambda values, voltage, **level: max(level.values()),
)

LOAD_FRICTION = Effect(
    name="load_friction",
    family="dry friction",
    description="dry friction proportional to the transmitted torque, as in a gear",
    equation="torque = -mu |K_t i| sign(omega), the sign smoothed as Coulomb friction's, the size "
    "over i = 0.1 V / R",
    parameters=(
        Parameter(
            "coefficient",
            "",
            0.0,
            0.8,  # the worst worm gears still pass on a fifth
            0.0,
            "share of the motor's torque that is lost, mu",
            scale=0.1,
        ),
    ),
    typical={"coefficient": 0.15},
    torque=_gear,
    needs=("J", "K_t", "R"),
    reference="Duclusaud, Passault, Padois, Ly, Extended friction models for the physics "
    "simulation of servo actuators, arXiv 2410.08650 (2024), load-dependent friction",
)
LOAD_FRICTION = _dry(
    LOAD_FRICTION,
    _elastic_gear,
    # The shaft is slow where the slope of the sign matters, so the current is that of stall.
    lambda values, voltage, coefficient: coefficient * values["K_t"] * voltage / values["R"],
)

STRIBECK_FRICTION = Effect(
    name="stribeck_friction",
    family="dry friction",
    description="dry friction that is larger near standstill",
    equation="torque = -(T + T_s exp(-(omega / omega_s)^2)) sign(omega), smoothed as Coulomb "
    "friction",
    parameters=(
        Parameter("torque", "N m", 0.0, default=0.0, description="at high speed, T", scale=0.05),
        Parameter("static", "N m", 0.0, default=0.0, description="more at 0, T_s", scale=0.05),
        Parameter(
            "velocity",
            "rad/s",
            1e-3,  # not 0, by which the law divides: slower than any shaft that is measured
            default=5.0,
            description="speed over which the excess fades, omega_s",
            scale=5.0,
        ),
    ),
    typical={"torque": 0.05, "static": 0.1, "velocity": 5.0},
    search={"torque": (0.01, 0.05, 0.2), "static": (0.0, 0.05, 0.2), "velocity": (1.0, 4.0, 15.0)},
    torque=_stribeck,
    needs=("J",),
    reference=SURVEY,
)
STRIBECK_FRICTION = _dry(
    STRIBECK_FRICTION,
    _elastic_stribeck,
    lambda values, voltage, torque, static, velocity: torque + static,
)

VISCOUS_FRICTION = Effect(
    name="viscous_friction",
    family="drag",
    description="viscous friction that differs from the file (an increment: b may be 0 there)",
    equation="b := b + increment, which must stay at least 0",
    parameters=(Parameter("b", "N m s", default=0.0, description="increment of b", scale=0.005),),
    typical={"b": 0.005},
    on_parameters=_viscous,
    needs=("b",),
    reference=SURVEY,
)

VISCOUS_ASYMMETRIC = Effect(
    name="viscous_asymmetric",
    family="drag",
    description="additional viscous friction that differs forward and backward",
    equation="torque = -b_f omega for omega > 0, -b_b omega for omega < 0",
    parameters=(
        Parameter(
            "b_forward", "N m s", 0.0, default=0.0, description="for omega > 0, b_f", scale=0.005
        ),
        Parameter(
            "b_backward", "N m s", 0.0, default=0.0, description="for omega < 0, b_b", scale=0.005
        ),
    ),
    typical={"b_forward": 0.006, "b_backward": 0.003},
    torque=_viscous_asymmetric,
    needs=("J",),
    fastest=lambda values, voltage, b_forward, b_backward: max(b_forward, b_backward) / values["J"],
    reference=f"{SURVEY} (coefficients that depend on the direction)",
)

QUADRATIC_DRAG = Effect(
    name="quadratic_drag",
    family="drag",
    description="drag of a fan or a stirrer, proportional to the square of the speed",
    equation="torque = -c omega |omega|",
    parameters=(
        Parameter("c", "N m s^2", 0.0, default=0.0, description="coefficient", scale=2e-4),
    ),
    typical={"c": 2e-4},
    torque=_quadratic,
    needs=("J",),
    # Twice the drag's slope at the no-load speed, since the slope is what a step must resolve.
    fastest=lambda values, voltage, c: 2 * c * voltage / (values["K_t"] * values["J"]),
    reference="White, Fluid Mechanics, chapter 11 (similarity of turbomachines)",
)
