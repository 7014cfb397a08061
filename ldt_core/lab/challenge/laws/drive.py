"""The electrical side, by laws other than the library's."""

from __future__ import annotations

from ldt_core.lab.challenge.law import Law, either, signed

TOP = 16.0  # V, beyond which no excitation goes: what a limit is measured against


def _factor(low):
    """A factor above 1 or, not below `low`, under it; the size is its distance from 1."""

    def values(size, s, known):
        return {"factor": 1.0 + size if s["sign"] > 0 else max(1.0 / (1.0 + size), low)}

    return values


def _draw_resistance(random, known):
    return {
        "sign": either(random),
        "contact": signed(random, 0.2, 0.6),  # of what the resistance has more or less
        "current": random.uniform(2.0, 8.0),
        "R": known["R"],
    }


def _resistance(p, v, s, odd):
    more = (v["factor"] - 1.0) * s["R"]
    p["R"] += more
    p["contact"], p["contact_current"] = odd * s["contact"] * more, s["current"]


def _draw_constant(random, known):
    return {
        "sign": either(random),
        "loss": random.uniform(0.3, 0.8),  # of what the constant has more or less
        "current": random.uniform(4.0, 12.0),
    }


def _constant(p, v, s, odd):
    p["K"] *= v["factor"]
    p["flux_loss"] = odd * s["loss"] * abs(v["factor"] - 1.0)
    p["flux_current"] = s["current"]


def _draw_inductance(random, known):
    return {
        "sign": 1.0 if random.random() < 0.8 else -1.0,
        "loss": random.uniform(0.3, 0.6),
        "current": random.uniform(4.0, 10.0),
    }


def _inductance(p, v, s, odd):
    p["L"] *= v["factor"]
    p["inductance_loss"], p["inductance_current"] = odd * s["loss"], s["current"]


def _draw_heating(random, known):
    return {
        "time": random.uniform(3.0, 15.0),
        "housing": random.uniform(0.2, 0.4),  # of the whole thermal resistance
        "housing_time": random.uniform(15.0, 60.0),
    }


def _heating(p, v, s, odd):
    share = odd * s["housing"]
    p["heat_winding"] = v["thermal_resistance"] * (1.0 - share)
    p["heat_housing"] = v["thermal_resistance"] * share
    p["time_winding"], p["time_housing"] = v["time_constant"], s["housing_time"]


def _draw_source(random, known):
    return {"rise": random.uniform(0.03, 0.08)}  # 1/A


def _source(p, v, s, odd):
    p["source"], p["source_rise"] = v["resistance"], odd * s["rise"]


def _saturation(p, v, s, odd):
    p["limit"] = v["limit"]
    # The knee is as wide, next to what is cut off, whatever the limit.
    sharpness = s["sharpness"] * v["limit"] / (TOP - v["limit"])
    p["limit_sharpness"] = sharpness / odd if odd > 0 else 0.0


def _dead(p, v, s, odd):
    p["dead"], p["dead_softness"] = v["width"], odd * s["softness"]


def _delay(p, v, s, odd):
    p["actuator_time"] = odd * s["actuator"] * v["delay"]
    p["delay"] = v["delay"] - p["actuator_time"]


def _brush(p, v, s, odd):
    p["brush"] = v["voltage"]
    p["brush_current"] = 0.1 + odd * s["softness"]
    p["brush_rise"] = odd * s["rise"]


def _block(p, v, s, odd):
    # A resistance in the way back that lets only 1 - share of the braking current through.
    p["block"] = s["R"] * v["share"] / (1.0 - v["share"])
    p["block_fall"] = odd * s["fall"]


LAWS = (
    Law(
        "armature_resistance",
        {"factor": ""},
        (0.003, 2.0),
        _draw_resistance,
        _factor(0.4),
        _resistance,
        family="resistance",
    ),
    Law("motor_constant", {"factor": ""}, (0.001, 0.6), _draw_constant, _factor(0.6), _constant),
    Law(
        "armature_inductance",
        {"factor": ""},
        (0.3, 40.0),
        _draw_inductance,
        _factor(0.1),
        _inductance,
    ),
    Law(
        "winding_heating",
        {"thermal_resistance": "K/W", "time_constant": "s"},
        (0.05, 100.0),
        _draw_heating,
        lambda size, s, known: {"thermal_resistance": size, "time_constant": s["time"]},
        _heating,
    ),
    Law(
        "source_resistance",
        {"resistance": "Ohm"},
        (0.003, 2.0),
        _draw_source,
        lambda size, s, known: {"resistance": size},
        _source,
        family="resistance",
    ),
    Law(
        "voltage_saturation",
        {"limit": "V"},
        (0.02, 0.7),
        lambda random, known: {"sharpness": random.uniform(6.0, 12.0)},
        lambda size, s, known: {"limit": TOP * (1.0 - size)},
        _saturation,
        place=lambda v, s, known: {
            "quantity": "voltage",
            "from": v["limit"],
            "to": TOP,
            "unit": "V",
            "either_sign": True,
        },
    ),
    Law(
        "input_deadzone",
        {"width": "V"},
        (0.01, 4.0),
        lambda random, known: {"softness": random.uniform(0.5, 1.2)},
        lambda size, s, known: {"width": size},
        _dead,
        family="voltage loss",
    ),
    Law(
        "input_delay",
        {"delay": "s"},
        (5e-4, 0.3),
        lambda random, known: {"actuator": random.uniform(0.3, 0.7)},
        lambda size, s, known: {"delay": size},
        _delay,
    ),
    Law(
        "brush_drop",
        {"voltage": "V"},
        (0.01, 4.0),
        lambda random, known: {
            "softness": random.uniform(0.05, 0.2),  # A
            "rise": random.uniform(0.05, 0.2),
        },
        lambda size, s, known: {"voltage": size},
        _brush,
        family="voltage loss",
    ),
    Law(
        "no_regeneration",
        {"share": ""},
        (0.05, 32.0),
        lambda random, known: {"R": known["R"], "fall": random.uniform(0.05, 0.2)},  # 1/A
        lambda size, s, known: {"share": size / (1.0 + size)},
        _block,
    ),
)
