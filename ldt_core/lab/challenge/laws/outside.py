"""Causes that no effect of the library is, nor a mixture of them: the right answer is "unknown"."""

from __future__ import annotations

import math

from ldt_core.lab.challenge.law import Law, signed

BAND_WIDTHS = 2.0  # half widths of a resonance: a fifth of its torque is left there
PERIOD_OF_DRIFT = 9  # experiments in which the oil's temperature goes from one end to the other


def _pulses(p, v, s, odd):
    p["pulse"], p["pulse_rate"] = v["torque"], s["rate"]


def _pulses_each(p, s, number, random):
    p["pulse_phase"] = random.uniform(0, 2 * math.pi)  # a machine of its own, in step with nothing


def _draw_window(random, known):
    begin = random.uniform(2.0, 13.0)
    return {
        "from": begin,
        "to": begin + random.uniform(1.5, 5.0),
        "wanders": float(random.random() < 0.5),
    }


def _window(p, v, s, odd):
    p["window"], p["window_from"], p["window_to"] = v["torque"], s["from"], s["to"]


def _window_each(p, s, number, random):
    if s["wanders"]:
        shift = random.uniform(1.0, 14.0) - s["from"]
        p["window_from"] += shift
        p["window_to"] += shift


def _window_place(v, s, known):
    if s["wanders"]:
        return None
    return {"quantity": "time", "from": s["from"], "to": s["to"], "unit": "s"}


def _speeds(begin, end=None):
    return {"quantity": "speed", "from": begin, "to": end, "unit": "rad/s"}


def _draw_backlash(random, known):
    return {
        "share": random.uniform(0.3, 0.6),
        "stiffness": random.uniform(40.0, 80.0),
        "J": known["J"],
    }


def _backlash(p, v, s, odd):
    p["far"] = s["share"] * s["J"]
    p["J"] -= p["far"]
    p["coupling"], p["coupling_damping"], p["backlash"] = s["stiffness"], 0.05, v["gap"]


def _hysteresis(p, v, s, odd):
    p["hysteresis"], p["hysteresis_width"] = v["torque"], s["width"]


def _stall(p, v, s, odd):
    p["drag"], p["drag_speed"] = v["torque"] / s["speed"] ** 2, s["speed"]
    p["drag_power"] = 3.0
    p["stall_speed"], p["stall_share"] = s["speed"], s["lost"]


def _band(p, v, s, odd):
    p["band"], p["band_speed"], p["band_width"] = v["torque"], s["speed"], s["width"]


def _encoder(p, v, s, odd):
    p["encoder"] = v["share"]


def _encoder_each(p, s, number, random):
    p["encoder_phase"] = s["phase"]


def _missed(p, v, s, odd):
    p["missed"], p["missed_speed"] = v["share"], s["speed"]


def _clutch(p, v, s, odd):
    p["far"] = s["share"] * s["J"]
    p["J"] -= p["far"]
    p["clutch"] = v["torque"]


def _limiter(p, v, s, odd):
    p["speed_limit"], p["limiter_gain"] = v["speed"], s["gain"]
    p["limiter_leak"] = s["leak"]


def _draw_limiter(random, known):
    return {
        "top": 14.0 / known["K_t"],
        "gain": random.uniform(2.0, 8.0),  # V/rad
        "leak": random.uniform(0.2, 0.6),  # 1/s
    }


def _current(p, v, s, odd):
    p["current_limit"] = v["current"]


def _walk(p, v, s, odd):
    p["walk"] = v["voltage"]


def _belt(p, v, s, odd):
    p["belt"], p["belt_order"] = v["torque"], s["order"]


def _belt_each(p, s, number, random):
    p["belt_phase"] = random.uniform(0, 2 * math.pi)


def _oil(p, v, s, odd):
    p["eddy"] = v["b"]


def _oil_each(p, s, number, random):
    # From thick to thin oil or back over the first ten experiments, then no further.
    along = min((number - 1) / PERIOD_OF_DRIFT, 1.0)
    p["eddy"] *= s["sign"] * (1.0 - 2.0 * along)


def _outside(name, parameter, sizes, draw, put, each=None, **more):
    def values(size, s, known):
        return {parameter: size}

    return Law(name, {}, sizes, draw, more.pop("values", values), put, each, **more)


LAWS = (
    _outside(
        "compressor_pulses",
        "torque",
        (0.005, 2.0),
        lambda random, known: {"rate": 2 * math.pi * random.uniform(0.4, 4.0)},
        _pulses,
        _pulses_each,
    ),
    _outside(
        "passing_load",
        "torque",
        (0.005, 2.0),
        _draw_window,
        _window,
        _window_each,
        place=_window_place,
    ),
    _outside(
        "backlash", "gap", (0.01, 1.0), _draw_backlash, _backlash, family="inertia", reversing=True
    ),
    _outside(
        "speed_hysteresis",
        "torque",
        (0.005, 2.0),
        lambda random, known: {"width": random.uniform(3.0, 6.0)},
        _hysteresis,
    ),
    _outside(
        "wandering_supply", "voltage", (0.01, 3.0), lambda random, known: {}, _walk, family="supply"
    ),
    _outside(
        "propeller_stall",
        "torque",
        (0.01, 1.5),
        lambda random, known: {
            "speed": random.uniform(24.0, 34.0),
            "lost": random.uniform(0.92, 1.0),
        },
        _stall,
    ),
    _outside(
        "resonance_band",
        "torque",
        (0.01, 2.0),
        lambda random, known: {
            "speed": random.uniform(19.0, 38.0),
            "width": random.uniform(0.8, 2.5),
        },
        _band,
        place=lambda v, s, known: _speeds(
            s["speed"] - BAND_WIDTHS * s["width"], s["speed"] + BAND_WIDTHS * s["width"]
        ),
    ),
    _outside(
        "eccentric_encoder",
        "share",
        (0.0005, 0.3),
        lambda random, known: {"phase": random.uniform(0, 2 * math.pi)},
        _encoder,
        _encoder_each,
    ),
    _outside(
        "missed_pulses",
        "share",
        (0.002, 0.6),
        lambda random, known: {"speed": random.uniform(22.0, 34.0)},
        _missed,
        place=lambda v, s, known: _speeds(s["speed"]),
    ),
    _outside(
        "slipping_clutch",
        "torque",
        (0.15, 100.0),
        lambda random, known: {"share": random.uniform(0.3, 0.6), "J": known["J"]},
        _clutch,
        values=lambda size, s, known: {"torque": 1.0 / size},
        family="inertia",
    ),
    _outside(
        "speed_limiter",
        "speed",
        (0.02, 0.75),
        _draw_limiter,
        _limiter,
        values=lambda size, s, known: {"speed": s["top"] * (1.0 - size)},
        place=lambda v, s, known: _speeds(v["speed"]),
    ),
    _outside(
        "current_limit",
        "current",
        (0.05, 12.0),
        lambda random, known: {"stall": 16.0 / known["R"]},
        _current,
        values=lambda size, s, known: {"current": s["stall"] / (1.0 + size)},
    ),
    _outside(
        "belt_wow",
        "torque",
        (0.005, 2.0),
        lambda random, known: {"order": random.uniform(0.15, 0.45)},
        _belt,
        _belt_each,
    ),
    _outside(
        "oil_temperature",
        "b",
        (1e-4, 0.05),
        lambda random, known: {"sign": math.copysign(1.0, signed(random, 1.0, 2.0))},
        _oil,
        _oil_each,
        values=lambda size, s, known: {"b": min(size, 0.95 * known["b"])},
    ),
)
