"""The speed sensor, by laws other than the library's."""

from __future__ import annotations

import math

from ldt_core.lab.challenge.law import Law, either, signed


def _draw_gain(random, known):
    return {"sign": either(random), "bend": signed(random, 0.2, 0.5)}


def _gain(p, v, s, odd):
    p["gain"], p["gain_bend"] = v["factor"], odd * s["bend"]


def _draw_bias(random, known):
    return {
        "sign": either(random),
        "wave": random.uniform(0.1, 0.22),
        "rate": 2 * math.pi / random.uniform(5.0, 40.0),
    }


def _bias(p, v, s, odd):
    p["bias"] = v["bias"]
    p["bias_wave"], p["bias_rate"] = odd * s["wave"], s["rate"]


def _lag(p, v, s, odd):
    # Two lags in a row, with the library's group delay together.
    p["lag_2"] = odd * s["second"] * v["time_constant"]
    p["lag_1"] = v["time_constant"] - p["lag_2"]


LAWS = (
    Law(
        "sensor_gain",
        {"factor": ""},
        (0.0005, 0.4),
        _draw_gain,
        lambda size, s, known: {"factor": 1.0 + s["sign"] * size},
        _gain,
    ),
    Law(
        "sensor_bias",
        {"bias": "rad/s"},
        (0.01, 8.0),
        _draw_bias,
        lambda size, s, known: {"bias": s["sign"] * size},
        _bias,
    ),
    Law(
        "sensor_lag",
        {"time_constant": "s"},
        (5e-4, 0.3),
        lambda random, known: {"second": random.uniform(0.3, 0.5)},
        lambda size, s, known: {"time_constant": size},
        _lag,
    ),
)
