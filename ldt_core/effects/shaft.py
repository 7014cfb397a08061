"""Inertia, elasticity and the motor's own ripple."""

from __future__ import annotations

import math

from ldt_core.base.compiled import njit
from ldt_core.effects.base import factor_of, scaled
from ldt_core.physics.effect import Effect
from ldt_core.physics.motor_rates import fastest_root
from ldt_core.physics.parameter import Parameter

LEAST_SHARE = 1e-30  # of the inertia at the far end, in place of a division by none
STEPS_PER_RADIAN = 2  # of a ripple's phase: 13 integration steps a period
STEPS_PER_CONTACT = 4  # integration steps in a radian of its swing: speeds are 0.1 % off at most
SOFT = 0.005  # of the slack, to either side of a touch: over which the ends' damping comes in
LEAST_TWIST = 1e-12  # [rad]: in place of a division by none


def _cogging(t, theta, omega, current, voltage, p):
    return -p[0] * math.sin(p[1] * theta + p[2])


def _cogging_rate(values, voltage, torque, periods, phase):
    ripple = STEPS_PER_RADIAN * periods * voltage / values["K_t"]
    return max(ripple, math.sqrt(torque * periods / values["J"])) if torque > 0 else 0.0


def _compliance(t, theta, omega, current, voltage, p, state, rate):
    stiffness, damping, near = p[1], p[2], p[3]
    share = max(p[0], LEAST_SHARE)
    there = p[0] / share  # 1, or 0 without a far end; by no decision, see `physics/lanes.py`
    far = near * share / (1.0 - share)
    moment = there * (stiffness * (theta - state[0]) + damping * (omega - state[1]))
    rate[0] = there * state[1]
    rate[1] = moment / far
    return -moment


def _compliance_rate(values, voltage, share, stiffness, damping):
    relative = values["J"] * share  # near and far inertia in series, for the J of the near end
    if share == 0.0:
        return 0.0
    return fastest_root(damping / relative, stiffness / relative)


@njit()
def _pushed(pressed, slip, p):  # pragma: no cover - compiled
    """Moment of two ends that touch, never a pull, for how far they are pressed together."""
    soft = max(SOFT * p[1], LEAST_TWIST)
    touch = min(max(0.5 + 0.5 * pressed / soft, 0.0), 1.0)
    return max(p[2] * max(pressed, 0.0) + p[3] * touch * slip, 0.0)


def _backlash(t, theta, omega, current, voltage, p, state, rate):
    near, share = p[4], max(p[0], LEAST_SHARE)
    there = p[0] / share
    far = near * share / (1.0 - share)
    twist, slip, free = theta - state[0], omega - state[1], 0.5 * p[1]
    moment = there * (_pushed(twist - free, slip, p) - _pushed(-twist - free, -slip, p))
    rate[0] = there * state[1]
    rate[1] = moment / far
    return -moment


def _backlash_rate(values, voltage, share, slack, stiffness, damping):
    if share == 0.0:
        return 0.0
    swings = STEPS_PER_CONTACT * math.sqrt(stiffness / (values["J"] * share))
    return max(swings, _compliance_rate(values, voltage, share, stiffness, damping))


def _without_far_end(values, share, **coupling):
    return scaled(values, 1.0 - share, "J")


def _far_end_like_near(state, **coupling):
    return state[0], state[1]


SHARE = Parameter("share", "", 0.0, 0.95, 0.0, "part of the inertia at the far end, s", scale=0.5)


INERTIA = Effect(
    name="inertia",
    family="inertia",
    description="moment of inertia that differs from the machine file",
    equation="J := factor J",
    parameters=(factor_of("of the moment of inertia"),),
    typical={"factor": 1.3},
    on_parameters=lambda values, factor: scaled(values, factor, "J"),
    needs=("J",),
    reference="Leonhard, Control of Electrical Drives, chapter 1 (inertia)",
)

COGGING_TORQUE = Effect(
    name="cogging_torque",
    family="angle",
    description="the motor's magnets are attracted by its teeth",
    equation="torque = -T sin(n theta + phi); theta counts from the start of the experiment",
    parameters=(
        Parameter("torque", "N m", 0.0, default=0.0, description="amplitude T", scale=0.05),
        Parameter("periods", "", 1.0, 200.0, 12.0, "periods a turn, n", scale=12.0),
        Parameter("phase", "rad", -math.pi, math.pi, 0.0, "at the start, phi", scale=1.0),
    ),
    typical={"torque": 0.3, "periods": 6.0},
    search={
        "torque": (0.1,),
        "periods": (
            1.0,
            2.0,
            3.0,
            4.0,
            5.0,
            6.0,
            7.0,
            8.0,
            9.0,
            10.0,
            12.0,
            14.0,
            16.0,
            18.0,
            24.0,
        ),
        "phase": (-math.pi / 2, 0.0, math.pi / 2, math.pi),
    },
    torque=_cogging,
    needs=("J", "K_t"),
    fastest=_cogging_rate,
    reference="Zhu, Howe, Influence of design parameters on cogging torque in permanent magnet "
    "machines, IEEE Transactions on Energy Conversion 15 (2000) 407",
)

TORSIONAL_COMPLIANCE = Effect(
    name="torsional_compliance",
    family="inertia",
    description="part of the inertia sits behind an elastic coupling (an eccentric mass does not)",
    equation="J := (1 - s) J; torque = -M, s J omega_far' = M, "
    "M = k (theta - theta_far) + d (omega - omega_far)",
    parameters=(
        SHARE,
        Parameter(
            "stiffness",
            "N m/rad",
            0.0,
            default=2.0,
            description="of the coupling, k",
            open_low=True,
            scale=2.0,
        ),
        Parameter(
            "damping", "N m s/rad", 0.0, default=0.01, description="of the coupling, d", scale=0.01
        ),
    ),
    typical={"share": 0.5},
    search={
        "share": (0.2, 0.6),
        "stiffness": (0.07, 0.3, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0),
        "damping": (0.001, 0.02),
    },
    most_factor=1000.0,  # from swings of a few seconds to those that no sample shows
    on_parameters=_without_far_end,
    torque=_compliance,
    states=("theta_far", "omega_far"),
    initial=_far_end_like_near,
    needs=("J",),
    fastest=_compliance_rate,
    reference="Inman, Engineering Vibration, chapter 4 (several degrees of freedom: torsion)",
)

BACKLASH = Effect(
    name="backlash",
    family="inertia",
    description="part of the inertia sits behind a gear or a coupling with free play",
    equation="J := (1 - s) J; torque = -M, s J omega_far' = M; beyond half of the slack M = "
    "k (theta - theta_far -+ slack / 2) + d (omega - omega_far), never a pull; "
    "theta_far begins at theta",
    parameters=(
        SHARE,
        Parameter(
            "slack", "rad", 0.0, default=0.2, description="free play at this shaft", scale=0.2
        ),
        Parameter(
            "stiffness",
            "N m/rad",
            0.0,
            default=30.0,
            description="of the contact, k",
            open_low=True,
            scale=30.0,
        ),
        Parameter(
            "damping", "N m s/rad", 0.0, default=0.1, description="of the contact, d", scale=0.1
        ),
    ),
    typical={"share": 0.5},
    search={
        "share": (0.2, 0.6),
        "slack": (0.03, 0.06, 0.12, 0.25, 0.5, 1.0),
        "stiffness": (3.0, 30.0),
        "damping": (0.1,),
    },
    most_factor=1000.0,
    on_parameters=_without_far_end,
    torque=_backlash,
    states=("theta_far", "omega_far"),
    initial=_far_end_like_near,
    needs=("J",),
    fastest=_backlash_rate,
    blows=True,
    reference="Nordin, Gutman, Controlling mechanical systems with backlash, a survey, "
    "Automatica 38 (2002) 1633",
)
