"""Friction and drag, by laws other than the library's."""

from __future__ import annotations

import math
from functools import partial

from ldt_core.lab.challenge import law
from ldt_core.lab.challenge.law import EITHER, Law, Signed, drawn, either

FRICTION: dict[str, Law] = {}
friction = partial(law.law, FRICTION)

#: Bristles bend by `bristle` [rad] before they slip; their damping [s] keeps them from ringing. At
#: low speed the level of dry friction is higher by `weakening`; it falls over `weakening_speed`.
BRISTLES: dict[str, law.Drawn] = {
    "bristle": (0.015, 0.04),
    "damping": (0.001, 0.004),
    "weakening": Signed(0.15, 0.45),
    "weakening_speed": (8.0, 40.0),
}


def _put_bristles(p, s, odd):
    p["bristle"], p["bristle_damping"] = s["bristle"], s["damping"]
    p["weakening"], p["weakening_speed"] = odd * s["weakening"], s["weakening_speed"]


@friction(
    "coulomb_friction", {"torque": "N m"}, (0.001, 1.2), drawn(*BRISTLES.items()), family="dry"
)
def _coulomb(p, v, s, odd):
    _put_bristles(p, s, odd)
    p["forward"] = p["backward"] = v["torque"]


@friction(
    "stribeck_friction",
    {"torque": "N m", "static": "N m", "velocity": "rad/s"},
    (0.001, 0.6),
    drawn(
        *BRISTLES.items(),
        weakening=Signed(0.05, 0.2),
        weakening_speed=(30.0, 60.0),
        static=(1.0, 3.0),  # over the level at high speed
        velocity=(3.0, 12.0),
        power=(1.5, 2.3),
    ),
    lambda size, s, known: {
        "torque": size,
        "static": size * s["static"],
        "velocity": s["velocity"],
    },
    family="dry",
    reversing=True,
)
def _stribeck(p, v, s, odd):
    _coulomb(p, v, s, odd)
    p["static"], p["stribeck_speed"] = v["static"], v["velocity"]
    p["stribeck_power"] = 2.0 + odd * (s["power"] - 2.0)


def _ratio(random):
    return math.exp(either(random) * random.uniform(math.log(1.5), math.log(4.0)))


def _by_direction(name):
    """A parameter forward and one backward, in the ratio drawn."""

    def values(size, s, known):
        root = math.sqrt(s["ratio"])
        return {f"{name}_forward": size * root, f"{name}_backward": size / root}

    return values


@friction(
    "asymmetric_friction",
    {"torque_forward": "N m", "torque_backward": "N m"},
    (0.001, 0.8),
    drawn(*BRISTLES.items(), ratio=_ratio),
    _by_direction("torque"),
    family="dry",
    reversing=True,
)
def _asymmetric(p, v, s, odd):
    _put_bristles(p, s, odd)
    p["forward"], p["backward"] = v["torque_forward"], v["torque_backward"]


@friction(
    "load_friction", {"coefficient": ""}, (0.003, 0.5), drawn(*BRISTLES.items()), family="dry"
)
def _gear(p, v, s, odd):
    _put_bristles(p, s, odd)
    p["gear"] = v["coefficient"]


# The speed at which the brake is strongest lies far above what the machine reaches. Its torque may
# also be less than the file says: a bearing with thinner oil.
@friction(
    "viscous_friction",
    {"b": "N m s"},
    (2e-5, 0.05),
    drawn(sign=EITHER, strongest=(60.0, 150.0)),
    lambda size, s, known: {"b": max(s["sign"] * size, -0.95 * known["b"])},
    family="viscous",
)
def _viscous(p, v, s, odd):
    p["eddy"] = p["eddy_backward"] = v["b"]
    p["eddy_slowness"] = odd / s["strongest"]


@friction(
    "viscous_asymmetric",
    {"b_forward": "N m s", "b_backward": "N m s"},
    (2e-5, 0.05),
    drawn(strongest=(60.0, 150.0), ratio=_ratio),
    _by_direction("b"),
    family="viscous",
    reversing=True,
)
def _viscous_by_direction(p, v, s, odd):
    p["eddy"], p["eddy_backward"] = v["b_forward"], v["b_backward"]
    p["eddy_slowness"] = odd / s["strongest"]


@friction(
    "quadratic_drag",
    {"c": "N m s^2"},
    (5e-7, 2e-3),
    drawn(power=Signed(0.03, 0.1), linear=(0.05, 0.2), speed=(20.0, 35.0)),
)
def _drag(p, v, s, odd):
    p["drag"], p["drag_speed"] = v["c"], s["speed"]
    p["drag_power"], p["drag_linear"] = 2.0 + odd * s["power"], odd * s["linear"]
