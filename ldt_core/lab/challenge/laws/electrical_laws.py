"""The electrical side and the speed sensor, by laws other than the library's."""

from __future__ import annotations

import math
from functools import partial

from ldt_core.lab.challenge import law
from ldt_core.lab.challenge.law import EITHER, Law, Signed, drawn

ELECTRICAL: dict[str, Law] = {}
electrical = partial(law.law, ELECTRICAL)

TOP = 16.0  # V, beyond which no excitation goes: what a limit is measured against


def factor(low):
    """A factor above 1 or, not below `low`, under it; the size is its distance from 1."""

    def values(size, s, known):
        return {"factor": 1.0 + size if s["sign"] > 0 else max(1.0 / (1.0 + size), low)}

    return values


def offset(size, s, known):
    """As much as the size, of either sign."""
    return {"bias": s["sign"] * size}


@electrical(
    "armature_resistance",
    {"factor": ""},
    (0.003, 2.0),
    # contact: of what the resistance has more or less
    drawn(sign=EITHER, contact=Signed(0.2, 0.6), current=(2.0, 8.0), R="R"),
    factor(0.4),
    family="resistance",
)
def _resistance(p, v, s, odd):
    more = (v["factor"] - 1.0) * s["R"]
    p["R"] += more
    p["contact"], p["contact_current"] = odd * s["contact"] * more, s["current"]


@electrical(
    "motor_constant",
    {"factor": ""},
    (0.001, 0.6),
    # loss: of what the constant has more or less
    drawn(sign=EITHER, loss=(0.3, 0.8), current=(4.0, 12.0)),
    factor(0.6),
    family="flux",
)
def _constant(p, v, s, odd):
    p["K"] *= v["factor"]
    p["flux_loss"] = odd * s["loss"] * abs(v["factor"] - 1.0)
    p["flux_current"] = s["current"]


@electrical(
    "magnetic_saturation",
    {"current": "A"},
    (0.02, 20.0),
    drawn(R="R", rest=(0.1, 0.3)),  # rest: of the constant, however large the current
    lambda size, s, known: {"current": TOP / s["R"] / math.sqrt(size)},
    family="flux",
)
def _flux(p, v, s, odd):
    p["flux_loss"], p["flux_current"] = 1.0 - odd * s["rest"], v["current"]


@electrical(
    "armature_inductance",
    {"factor": ""},
    (0.3, 40.0),
    drawn(
        sign=lambda random: 1.0 if random.random() < 0.8 else -1.0,
        loss=(0.3, 0.6),
        current=(4.0, 10.0),
    ),
    factor(0.1),
)
def _inductance(p, v, s, odd):
    p["L"] *= v["factor"]
    p["inductance_loss"], p["inductance_current"] = odd * s["loss"], s["current"]


@electrical(
    "winding_heating",
    {"thermal_resistance": "K/W", "time_constant": "s"},
    (0.05, 100.0),
    # housing: its part of the whole thermal resistance
    drawn(time=(3.0, 15.0), housing=(0.2, 0.4), housing_time=(15.0, 60.0)),
    lambda size, s, known: {"thermal_resistance": size, "time_constant": s["time"]},
)
def _heating(p, v, s, odd):
    share = odd * s["housing"]
    p["heat_winding"] = v["thermal_resistance"] * (1.0 - share)
    p["heat_housing"] = v["thermal_resistance"] * share
    p["time_winding"], p["time_housing"] = v["time_constant"], s["housing_time"]


@electrical(
    "source_resistance",
    {"resistance": "Ohm"},
    (0.003, 2.0),
    drawn(rise=(0.03, 0.08)),  # 1/A
    family="resistance",
)
def _source(p, v, s, odd):
    p["source"], p["source_rise"] = v["resistance"], odd * s["rise"]


def _cut_off(v, s, known):
    ends = {"from": v["limit"], "to": TOP}
    return {"quantity": "voltage", **ends, "unit": "V", "either_sign": True}


@electrical(
    "voltage_saturation",
    {"limit": "V"},
    (0.02, 0.7),
    drawn(sharpness=(6.0, 12.0)),
    lambda size, s, known: {"limit": TOP * (1.0 - size)},
    place=_cut_off,
)
def _saturation(p, v, s, odd):
    p["limit"] = v["limit"]
    # The knee is as wide, next to what is cut off, whatever the limit.
    sharpness = s["sharpness"] * v["limit"] / (TOP - v["limit"])
    p["limit_sharpness"] = sharpness / odd if odd > 0 else 0.0


@electrical(
    "current_limit",
    {"limit": "A"},
    (0.05, 12.0),
    drawn(R="R", softness=(0.4, 0.8)),
    lambda size, s, known: {"limit": TOP / s["R"] / (1.0 + size)},
    quick=True,
)
def _current(p, v, s, odd):
    p["current_limit"] = v["limit"]
    p["current_contact"] *= 1.0 - odd * s["softness"]


@electrical(
    "input_deadzone", {"width": "V"}, (0.01, 4.0), drawn(softness=(0.5, 1.2)), family="voltage loss"
)
def _dead(p, v, s, odd):
    p["dead"], p["dead_softness"] = v["width"], odd * s["softness"]


#: A gain, off by more or less at large sizes: units, sizes, draw, values.
MULTIPLIES = (
    {"factor": ""},
    (0.0005, 0.4),
    drawn(sign=EITHER, bend=Signed(0.2, 0.5)),
    lambda size, s, known: {"factor": 1.0 + s["sign"] * size},
)


@electrical("input_gain", *MULTIPLIES, family="gain")
def _input_gain(p, v, s, odd):
    p["supply_gain"], p["supply_bend"] = v["factor"], odd * s["bend"]


@electrical(
    "input_bias",
    {"bias": "V"},
    (0.001, 2.0),
    drawn(sign=EITHER, fall=Signed(0.2, 0.5)),
    offset,
    family="offset",
)
def _input_bias(p, v, s, odd):
    p["supply_bias"], p["supply_bias_fall"] = v["bias"], odd * s["fall"]


@electrical("input_delay", {"delay": "s"}, (5e-4, 0.3), drawn(actuator=(0.3, 0.7)))
def _delay(p, v, s, odd):
    p["actuator_time"] = odd * s["actuator"] * v["delay"]
    p["delay"] = v["delay"] - p["actuator_time"]


@electrical("input_lag", {"time_constant": "s"}, (5e-4, 0.3), drawn(late=(0.3, 0.5)))
def _slow_drive(p, v, s, odd):
    # In part a pure delay, with the library's group delay together.
    p["delay"] = odd * s["late"] * v["time_constant"]
    p["actuator_time"] = v["time_constant"] - p["delay"]


@electrical(
    "brush_drop",
    {"voltage": "V"},
    (0.01, 4.0),
    drawn(softness=(0.05, 0.2), rise=(0.05, 0.2)),  # softness: A
    family="voltage loss",
)
def _brush(p, v, s, odd):
    p["brush"] = v["voltage"]
    p["brush_current"] = 0.1 + odd * s["softness"]
    p["brush_rise"] = odd * s["rise"]


#: A resistance that lets only 1 - share of a current through: units, sizes, draw, values.
LETS_LESS_THROUGH = (
    {"share": ""},
    (0.05, 32.0),
    drawn(R="R", fall=(0.05, 0.2)),  # fall: 1/A
    lambda size, s, known: {"share": size / (1.0 + size)},
)


def _put_less_through(p, v, s, odd, name):
    p[name] = s["R"] * v["share"] / (1.0 - v["share"])
    p[f"{name}_fall"] = odd * s["fall"]


@electrical("no_regeneration", *LETS_LESS_THROUGH, family="braking", quick=True)
def _block(p, v, s, odd):
    _put_less_through(p, v, s, odd, "block")  # in the way back of the braking current


@electrical("open_circuit", *LETS_LESS_THROUGH, family="braking", quick=True, pausing=True)
def _open(p, v, s, odd):
    _put_less_through(p, v, s, odd, "open")


@electrical("sensor_gain", *MULTIPLIES, family="gain")
def _gain(p, v, s, odd):
    p["gain"], p["gain_bend"] = v["factor"], odd * s["bend"]


@electrical(
    "sensor_bias",
    {"bias": "rad/s"},
    (0.01, 8.0),
    drawn(
        sign=EITHER, wave=(0.1, 0.22), rate=lambda random: 2 * math.pi / random.uniform(5.0, 40.0)
    ),
    offset,
    family="offset",
)
def _bias(p, v, s, odd):
    p["bias"] = v["bias"]
    p["bias_wave"], p["bias_rate"] = odd * s["wave"], s["rate"]


@electrical("sensor_lag", {"time_constant": "s"}, (5e-4, 0.3), drawn(second=(0.3, 0.5)))
def _lag(p, v, s, odd):
    # Two lags in a row, with the library's group delay together.
    p["lag_2"] = odd * s["second"] * v["time_constant"]
    p["lag_1"] = v["time_constant"] - p["lag_2"]
