"""Shaft, foundation and load, by laws other than the library's."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from ldt_core.lab.challenge import law
from ldt_core.lab.challenge.law import EITHER, Law, Signed, drawn, either, speeds

MECHANICAL: dict[str, Law] = {}
mechanical = partial(law.law, MECHANICAL)

HARDENING = (2.0, 20.0)  # 1/m^2: 0.2 to 2 % stiffer at 3 cm, which it reaches in resonance
HEARD = 0.1  # of the largest torque of the unbalance, above which a speed counts as its place
ANGLE = (-math.pi, math.pi)  # rad


# A part of what the inertia has more or less hangs behind a fluid coupling.
@mechanical(
    "inertia",
    {"factor": ""},
    (0.003, 3.0),
    drawn(sign=EITHER, fluid=(0.2, 0.5), time=(0.03, 0.1), J="J"),
    lambda size, s, known: {
        "factor": 1.0 + size if s["sign"] > 0 else max(1.0 / (1.0 + size), 0.3)
    },
    family="inertia",
)
def _inertia(p, v, s, odd):
    more = (v["factor"] - 1.0) * s["J"]
    fluid = odd * s["fluid"] * abs(more)
    p["J"] += more - fluid
    p["fluid"], p["fluid_time"] = fluid, s["time"]


@mechanical(
    "cogging_torque",
    {"torque": "N m", "periods": "", "phase": "rad"},
    (0.003, 0.6),
    drawn(
        periods=lambda random: float(random.choice([2, 3, 4, 5, 6, 7, 8, 9, 12])),
        phase=ANGLE,
        second=(0.1, 0.3),
        second_phase=ANGLE,
    ),
    lambda size, s, known: {"torque": size, "periods": s["periods"], "phase": s["phase"]},
    kept=("periods",),
)
def _cogging(p, v, s, odd):
    p["cog"], p["cog_periods"], p["cog_phase"] = v["torque"], v["periods"], v["phase"]
    p["cog_second"], p["cog_second_phase"] = odd * s["second"], s["second_phase"]


def _coupling(stiffness, s, known):
    relative = known["J"] * s["share"] * (1.0 - s["share"])
    damping = 2.0 * s["damping"] * math.sqrt(stiffness * relative)
    return {"share": s["share"], "stiffness": stiffness, "damping": damping}


@mechanical(
    "torsional_compliance",
    {"share": "", "stiffness": "N m/rad", "damping": "N m s/rad"},
    (0.002, 5.0),
    # damping: of the critical one; cubic: how much stiffer under 1 N m
    drawn(share=(0.3, 0.7), damping=(0.03, 0.25), cubic=(0.05, 0.3), J="J"),
    lambda size, s, known: _coupling(1.0 / size, s, known),
    family="inertia",
)
def _compliance(p, v, s, odd):
    p["far"] = v["share"] * s["J"]
    p["J"] -= p["far"]
    p["coupling"], p["coupling_damping"] = v["stiffness"], v["damping"]
    p["coupling_cubic"] = odd * s["cubic"] * v["stiffness"] ** 2


@mechanical(
    "backlash",
    {"share": "", "slack": "rad", "stiffness": "N m/rad", "damping": "N m s/rad"},
    (0.02, 0.6),
    # as above; of a blow's 10 N m, teeth are up to twice as stiff
    drawn(
        share=(0.3, 0.6), stiffness=(40.0, 80.0), damping=(0.03, 0.25), cubic=(0.002, 0.01), J="J"
    ),
    lambda size, s, known: {
        "share": s["share"],
        "slack": size,
        **_coupling(s["stiffness"], s, known),
    },
    family="inertia",
    reversing=True,
)
def _backlash(p, v, s, odd):
    _compliance(p, v, s, odd)
    p["backlash"] = v["slack"] / 2


def _unbalance_place(v, s, known):
    """Speeds at which the unbalance takes a tenth or more of its largest torque below 50 rad/s.

    The power that the foundation's dampers take at a steady speed, over that speed.
    """
    speed = np.linspace(2.0, 50.0, 481)
    mass, torque = known["m"] + known["M"], np.zeros(481)
    for axis in "xy":
        stiffness, damping = known[f"K_{axis}"], known[f"R_{axis}"]
        torque += speed**5 * damping / ((stiffness - mass * speed**2) ** 2 + (speed * damping) ** 2)
    inside = speed[torque >= HEARD * torque.max()]
    return speeds(float(inside[0]), float(inside[-1]))


@mechanical(
    "unbalance",
    {"e": "m"},
    (0.001, 0.012),
    drawn(hardening=HARDENING, e="e", m="m"),
    family="foundation",
    needs="rotor",
    place=_unbalance_place,
)
def _unbalance(p, v, s, odd):
    e = s["e"] + v["e"]
    p["J"] += s["m"] * (e**2 - s["e"] ** 2)
    p["unbalance"] = s["m"] * e
    p["duffing"] = odd * s["hardening"]


def _draw_foundation(random, known):
    sign = either(random)
    return {
        "x": sign * random.uniform(0.5, 1.0),
        "y": sign * random.uniform(0.5, 1.0) * (1.0 if random.random() < 0.7 else -1.0),
        "hardening": random.uniform(*HARDENING),
    }


def _foundation(name, sizes, letter):
    @mechanical(
        name,
        {"x": "", "y": ""},
        sizes,
        _draw_foundation,
        lambda size, s, known: {"x": math.exp(size * s["x"]), "y": math.exp(size * s["y"])},
        family="foundation",
        needs="eccentric",
    )
    def put(p, v, s, odd):
        p[f"{letter}_x"] *= v["x"]
        p[f"{letter}_y"] *= v["y"]
        p["duffing"] = odd * s["hardening"]


_foundation("foundation_stiffness", (0.01, 0.7), "K")
_foundation("foundation_damping", (0.05, 1.6), "R")


# A rope's layers on the drum, or its own weight: the load changes over some turns.
@mechanical(
    "constant_load",
    {"torque": "N m"},
    (0.001, 1.2),
    drawn(growth=Signed(0.1, 0.3), angle=(50.0, 300.0)),
)
def _load(p, v, s, odd):
    p["load"] = v["torque"]
    p["load_growth"], p["load_angle"] = odd * s["growth"], s["angle"]


def _hanging(random):
    """A shaft at rest hangs down, if no brake holds it [rad]."""
    return -math.pi / 2 if random.random() < 0.5 else random.uniform(*ANGLE)


@mechanical(
    "gravity_imbalance",
    {"torque": "N m", "phase": "rad"},
    (0.003, 0.8),
    drawn(phase=_hanging, second=Signed(0.1, 0.25)),
    lambda size, s, known: {"torque": size, "phase": s["phase"]},
)
def _gravity(p, v, s, odd):
    p["gravity"], p["gravity_phase"] = v["torque"], v["phase"]
    p["gravity_second"] = odd * s["second"]


# A spring that becomes stiffer, or softer, the further it is turned.
@mechanical(
    "spring_load",
    {"stiffness": "N m/rad"},
    (0.0003, 2.0),
    drawn(rise=Signed(0.03, 0.15), angle=(3.0, 30.0)),
    from_rest=True,
)
def _spring(p, v, s, odd):
    p["spring"] = v["stiffness"]
    p["spring_rise"], p["spring_angle"] = odd * s["rise"], s["angle"]
