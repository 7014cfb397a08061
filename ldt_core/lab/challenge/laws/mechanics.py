"""Shaft, foundation and load, by laws other than the library's."""

from __future__ import annotations

import math

import numpy as np

from ldt_core.lab.challenge.law import Law, either, signed

HARDENING = (2.0, 20.0)  # 1/m^2: 0.2 to 2 % stiffer at 3 cm, which it reaches in resonance
HEARD = 0.1  # of the largest torque of the unbalance, above which a speed counts as its place


def _draw_inertia(random, known):
    # A part of what the inertia has more or less hangs behind a fluid coupling.
    return {
        "sign": either(random),
        "fluid": random.uniform(0.2, 0.5),
        "time": random.uniform(0.03, 0.1),
        "J": known["J"],
    }


def _inertia_values(size, s, known):
    return {"factor": 1.0 + size if s["sign"] > 0 else max(1.0 / (1.0 + size), 0.3)}


def _inertia(p, v, s, odd):
    more = (v["factor"] - 1.0) * s["J"]
    fluid = odd * s["fluid"] * abs(more)
    p["J"] += more - fluid
    p["fluid"], p["fluid_time"] = fluid, s["time"]


def _draw_cogging(random, known):
    return {
        "periods": float(random.choice([2, 3, 4, 5, 6, 7, 8, 9, 12])),
        "phase": random.uniform(-math.pi, math.pi),
        "second": random.uniform(0.1, 0.3),
        "second_phase": random.uniform(-math.pi, math.pi),
    }


def _cogging(p, v, s, odd):
    p["cog"], p["cog_periods"], p["cog_phase"] = v["torque"], v["periods"], v["phase"]
    p["cog_second"], p["cog_second_phase"] = odd * s["second"], s["second_phase"]


def _draw_compliance(random, known):
    return {
        "share": random.uniform(0.3, 0.7),
        "damping": random.uniform(0.03, 0.25),  # of the critical one
        "cubic": random.uniform(0.05, 0.3),  # how much stiffer under 1 N m
        "J": known["J"],
    }


def _compliance_values(size, s, known):
    stiffness = 1.0 / size
    relative = known["J"] * s["share"] * (1.0 - s["share"])
    damping = 2.0 * s["damping"] * math.sqrt(stiffness * relative)
    return {"share": s["share"], "stiffness": stiffness, "damping": damping}


def _compliance(p, v, s, odd):
    p["far"] = v["share"] * s["J"]
    p["J"] -= p["far"]
    p["coupling"], p["coupling_damping"] = v["stiffness"], v["damping"]
    p["coupling_cubic"] = odd * s["cubic"] * v["stiffness"] ** 2


def _draw_unbalance(random, known):
    return {"hardening": random.uniform(*HARDENING), "e": known["e"], "m": known["m"]}


def _put_unbalance(p, e, s):
    p["J"] += s["m"] * (e**2 - s["e"] ** 2)
    p["unbalance"] = s["m"] * e


def _unbalance(p, v, s, odd):
    _put_unbalance(p, s["e"] + v["e"], s)
    p["duffing"] = odd * s["hardening"]


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
    return {
        "quantity": "speed",
        "from": float(inside[0]),
        "to": float(inside[-1]),
        "unit": "rad/s",
    }


def _draw_foundation(random, known):
    sign = either(random)
    return {
        "x": sign * random.uniform(0.5, 1.0),
        "y": sign * random.uniform(0.5, 1.0) * (1.0 if random.random() < 0.7 else -1.0),
        "hardening": random.uniform(*HARDENING),
    }


def _foundation_values(size, s, known):
    return {"x": math.exp(size * s["x"]), "y": math.exp(size * s["y"])}


def _foundation(letter):
    def put(p, v, s, odd):
        p[f"{letter}_x"] *= v["x"]
        p[f"{letter}_y"] *= v["y"]
        p["duffing"] = odd * s["hardening"]

    return put


def _draw_load(random, known):
    # A rope's layers on the drum, or its own weight: the load changes over some turns.
    return {"growth": signed(random, 0.1, 0.3), "angle": random.uniform(50.0, 300.0)}


def _load(p, v, s, odd):
    p["load"] = v["torque"]
    p["load_growth"], p["load_angle"] = odd * s["growth"], s["angle"]


def _draw_gravity(random, known):
    # A shaft at rest hangs down, if no brake holds it.
    hangs = random.random() < 0.5
    return {
        "phase": -math.pi / 2 if hangs else random.uniform(-math.pi, math.pi),
        "second": signed(random, 0.1, 0.25),
    }


def _gravity(p, v, s, odd):
    p["gravity"], p["gravity_phase"] = v["torque"], v["phase"]
    p["gravity_second"] = odd * s["second"]


LAWS = (
    Law(
        "inertia",
        {"factor": ""},
        (0.003, 3.0),
        _draw_inertia,
        _inertia_values,
        _inertia,
        family="inertia",
    ),
    Law(
        "cogging_torque",
        {"torque": "N m", "periods": "", "phase": "rad"},
        (0.003, 0.6),
        _draw_cogging,
        lambda size, s, known: {"torque": size, "periods": s["periods"], "phase": s["phase"]},
        _cogging,
        kept=("periods",),
    ),
    Law(
        "torsional_compliance",
        {"share": "", "stiffness": "N m/rad", "damping": "N m s/rad"},
        (0.002, 5.0),
        _draw_compliance,
        _compliance_values,
        _compliance,
        family="inertia",
    ),
    Law(
        "unbalance",
        {"e": "m"},
        (0.001, 0.012),
        _draw_unbalance,
        lambda size, s, known: {"e": size},
        _unbalance,
        family="foundation",
        needs="rotor",
        place=_unbalance_place,
    ),
    Law(
        "foundation_stiffness",
        {"x": "", "y": ""},
        (0.01, 0.7),
        _draw_foundation,
        _foundation_values,
        _foundation("K"),
        family="foundation",
        needs="eccentric",
    ),
    Law(
        "foundation_damping",
        {"x": "", "y": ""},
        (0.05, 1.6),
        _draw_foundation,
        _foundation_values,
        _foundation("R"),
        family="foundation",
        needs="eccentric",
    ),
    Law(
        "constant_load",
        {"torque": "N m"},
        (0.001, 1.2),
        _draw_load,
        lambda size, s, known: {"torque": size},
        _load,
    ),
    Law(
        "gravity_imbalance",
        {"torque": "N m", "phase": "rad"},
        (0.003, 0.8),
        _draw_gravity,
        lambda size, s, known: {"torque": size, "phase": s["phase"]},
        _gravity,
    ),
)
