"""Friction and drag, by laws other than the library's."""

from __future__ import annotations

import math

from ldt_core.lab.challenge.law import Law, either, signed

# Bristles bend by this before they slip [rad]; their damping [s] keeps them from ringing.
BRISTLE, DAMPING = (0.015, 0.04), (0.001, 0.004)
# How much higher the level of dry friction is at low speed, and the speed over which it falls.
WEAKENING, WEAKENING_SPEED = (0.15, 0.45), (8.0, 40.0)


def _bristles(random, known):
    return {
        "bristle": random.uniform(*BRISTLE),
        "damping": random.uniform(*DAMPING),
        "weakening": signed(random, *WEAKENING),
        "weakening_speed": random.uniform(*WEAKENING_SPEED),
    }


def _put_bristles(p, s, odd):
    p["bristle"], p["bristle_damping"] = s["bristle"], s["damping"]
    p["weakening"], p["weakening_speed"] = odd * s["weakening"], s["weakening_speed"]


def _coulomb(p, v, s, odd):
    _put_bristles(p, s, odd)
    p["forward"] = p["backward"] = v["torque"]


def _draw_stribeck(random, known):
    return {
        **_bristles(random, known),
        "weakening": signed(random, 0.05, 0.2),
        "weakening_speed": random.uniform(30.0, 60.0),
        "static": random.uniform(1.0, 3.0),  # over the level at high speed
        "velocity": random.uniform(3.0, 12.0),
        "power": random.uniform(1.5, 2.3),
    }


def _stribeck(p, v, s, odd):
    _coulomb(p, v, s, odd)
    p["static"], p["stribeck_speed"] = v["static"], v["velocity"]
    p["stribeck_power"] = 2.0 + odd * (s["power"] - 2.0)


def _draw_asymmetric(random, known):
    return {
        **_bristles(random, known),
        "ratio": math.exp(either(random) * random.uniform(math.log(1.5), math.log(4.0))),
    }


def _asymmetric(p, v, s, odd):
    _put_bristles(p, s, odd)
    p["forward"], p["backward"] = v["torque_forward"], v["torque_backward"]


def _gear(p, v, s, odd):
    _put_bristles(p, s, odd)
    p["gear"] = v["coefficient"]


def _draw_viscous(random, known):
    # The speed at which the brake is strongest lies far above what the machine reaches. Its torque
    # may also be less than the file says: a bearing with thinner oil.
    return {"sign": either(random), "strongest": random.uniform(60.0, 150.0)}


def _viscous_values(size, s, known):
    least = -0.95 * known["b"]
    return {"b": max(s["sign"] * size, least)}


def _viscous(p, v, s, odd):
    p["eddy"], p["eddy_slowness"] = v["b"], odd / s["strongest"]


def _draw_drag(random, known):
    return {
        "power": signed(random, 0.03, 0.1),
        "linear": random.uniform(0.05, 0.2),
        "speed": random.uniform(20.0, 35.0),
    }


def _drag(p, v, s, odd):
    p["drag"], p["drag_speed"] = v["c"], s["speed"]
    p["drag_power"], p["drag_linear"] = 2.0 + odd * s["power"], odd * s["linear"]


LAWS = (
    Law(
        "coulomb_friction",
        {"torque": "N m"},
        (0.001, 1.2),
        _bristles,
        lambda size, s, known: {"torque": size},
        _coulomb,
        family="dry",
    ),
    Law(
        "stribeck_friction",
        {"torque": "N m", "static": "N m", "velocity": "rad/s"},
        (0.001, 0.6),
        _draw_stribeck,
        lambda size, s, known: {
            "torque": size,
            "static": size * s["static"],
            "velocity": s["velocity"],
        },
        _stribeck,
        family="dry",
        reversing=True,
    ),
    Law(
        "asymmetric_friction",
        {"torque_forward": "N m", "torque_backward": "N m"},
        (0.001, 0.8),
        _draw_asymmetric,
        lambda size, s, known: {
            "torque_forward": size * math.sqrt(s["ratio"]),
            "torque_backward": size / math.sqrt(s["ratio"]),
        },
        _asymmetric,
        family="dry",
        reversing=True,
    ),
    Law(
        "gear_friction",
        {"coefficient": ""},
        (0.003, 0.5),
        _bristles,
        lambda size, s, known: {"coefficient": size},
        _gear,
        family="dry",
    ),
    Law(
        "viscous_friction",
        {"b": "N m s"},
        (2e-5, 0.05),
        _draw_viscous,
        _viscous_values,
        _viscous,
    ),
    Law(
        "quadratic_drag",
        {"c": "N m s^2"},
        (5e-7, 2e-3),
        _draw_drag,
        lambda size, s, known: {"c": size},
        _drag,
    ),
)
