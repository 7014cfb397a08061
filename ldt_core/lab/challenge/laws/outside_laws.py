"""Causes that no effect of the library is, nor a mixture of them: the right answer is "unknown"."""

from __future__ import annotations

import math
from functools import partial

from ldt_core.lab.challenge import law
from ldt_core.lab.challenge.law import Law, drawn, speeds

OUTSIDE: dict[str, Law] = {}
outside = partial(law.law, OUTSIDE)

BAND_WIDTHS = 2.0  # half widths of a resonance: a fifth of its torque is left there
PERIOD_OF_DRIFT = 9  # experiments in which the oil's temperature goes from one end to the other
TURN = (0.0, 2 * math.pi)  # rad


def _pulses_each(p, s, number, random):
    p["pulse_phase"] = random.uniform(*TURN)  # a machine of its own, in step with nothing


@outside(
    "compressor_pulses",
    "torque",
    (0.005, 2.0),
    drawn(rate=lambda random: 2 * math.pi * random.uniform(0.4, 4.0)),
    each=_pulses_each,
)
def _pulses(p, v, s, odd):
    p["pulse"], p["pulse_rate"] = v["torque"], s["rate"]


def _draw_window(random, known):
    begin = random.uniform(2.0, 13.0)
    return {
        "from": begin,
        "to": begin + random.uniform(1.5, 5.0),
        "wanders": float(random.random() < 0.5),
    }


def _window_each(p, s, number, random):
    if s["wanders"]:
        shift = random.uniform(1.0, 14.0) - s["from"]
        p["window_from"] += shift
        p["window_to"] += shift


def _window_place(v, s, known):
    if s["wanders"]:
        return None
    return {"quantity": "time", "from": s["from"], "to": s["to"], "unit": "s"}


@outside(
    "passing_load", "torque", (0.005, 2.0), _draw_window, each=_window_each, place=_window_place
)
def _window(p, v, s, odd):
    p["window"], p["window_from"], p["window_to"] = v["torque"], s["from"], s["to"]


@outside("speed_hysteresis", "torque", (0.005, 2.0), drawn(width=(3.0, 6.0)))
def _hysteresis(p, v, s, odd):
    p["hysteresis"], p["hysteresis_width"] = v["torque"], s["width"]


@outside("wandering_supply", "voltage", (0.01, 3.0), drawn(), family="supply")
def _walk(p, v, s, odd):
    p["walk"] = v["voltage"]


@outside("propeller_stall", "torque", (0.01, 1.5), drawn(speed=(24.0, 34.0), lost=(0.92, 1.0)))
def _stall(p, v, s, odd):
    p["drag"], p["drag_speed"] = v["torque"] / s["speed"] ** 2, s["speed"]
    p["drag_power"] = 3.0
    p["stall_speed"], p["stall_share"] = s["speed"], s["lost"]


def _band_place(v, s, known):
    half = BAND_WIDTHS * s["width"]
    return speeds(s["speed"] - half, s["speed"] + half)


@outside(
    "resonance_band",
    "torque",
    (0.01, 2.0),
    drawn(speed=(19.0, 38.0), width=(0.8, 2.5)),
    place=_band_place,
)
def _band(p, v, s, odd):
    p["band"], p["band_speed"], p["band_width"] = v["torque"], s["speed"], s["width"]


@outside("eccentric_encoder", "share", (0.0005, 0.3), drawn(phase=TURN))
def _encoder(p, v, s, odd):
    p["encoder"], p["encoder_phase"] = v["share"], s["phase"]


@outside(
    "missed_pulses",
    "share",
    (0.002, 0.6),
    drawn(speed=(22.0, 34.0)),
    place=lambda v, s, known: speeds(s["speed"]),
)
def _missed(p, v, s, odd):
    p["missed"], p["missed_speed"] = v["share"], s["speed"]


@outside(
    "slipping_clutch",
    "torque",
    (0.15, 100.0),
    drawn(share=(0.3, 0.6), J="J"),
    lambda size, s, known: {"torque": 1.0 / size},
    family="inertia",
)
def _clutch(p, v, s, odd):
    p["far"] = s["share"] * s["J"]
    p["J"] -= p["far"]
    p["clutch"] = v["torque"]


def _draw_limiter(random, known):
    return {
        "top": 14.0 / known["K_t"],
        "gain": random.uniform(2.0, 8.0),  # V/rad
        "leak": random.uniform(0.2, 0.6),  # 1/s
    }


@outside(
    "speed_limiter",
    "speed",
    (0.02, 0.75),
    _draw_limiter,
    lambda size, s, known: {"speed": s["top"] * (1.0 - size)},
    place=lambda v, s, known: speeds(v["speed"]),
)
def _limiter(p, v, s, odd):
    p["speed_limit"], p["limiter_gain"] = v["speed"], s["gain"]
    p["limiter_leak"] = s["leak"]


def _belt_each(p, s, number, random):
    p["belt_phase"] = random.uniform(*TURN)


@outside("belt_wow", "torque", (0.005, 2.0), drawn(order=(0.15, 0.45)), each=_belt_each)
def _belt(p, v, s, odd):
    p["belt"], p["belt_order"] = v["torque"], s["order"]


def _oil_each(p, s, number, random):
    # From thick to thin oil or back over the first ten experiments, then no further.
    along = min((number - 1) / PERIOD_OF_DRIFT, 1.0)
    p["eddy"] *= s["sign"] * (1.0 - 2.0 * along)


def _oil_sign(random):
    sign = law.either(random)
    random.uniform()  # keys that are published were drawn with a size beside the sign
    return sign


@outside(
    "oil_temperature",
    "b",
    (1e-4, 0.05),
    drawn(sign=_oil_sign),
    lambda size, s, known: {"b": min(size, 0.95 * known["b"])},
    each=_oil_each,
)
def _oil(p, v, s, odd):
    p["eddy"] = v["b"]
