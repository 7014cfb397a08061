"""All numbers of a machine of the challenge, in one record that the compiled equations read.

A field of 0 switches its law off, unless `ideal` says otherwise; all are in SI units.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

#: State of a machine: what each entry of the vector is.
STATES = (
    *("theta", "omega", "current", "x", "vx", "y", "vy", "bristle", "winding", "housing"),
    *("actuator", "far_angle", "far_speed", "fluid_speed", "sensor_1", "sensor_2", "memory"),
)

# Absolute tolerance of each state: a millionth or less of what it is in a machine that runs.
TOLERANCES = np.full(len(STATES), 1e-8)
TOLERANCES[3:8] = 1e-11, 1e-10, 1e-11, 1e-10, 1e-9
TOLERANCES[8:10] = 1e-7

_FIELDS = {
    "motor": ("K", "R", "L", "J", "b"),
    "rotor": ("unbalance", "mass", "K_x", "K_y", "R_x", "R_y", "duffing"),
    "dry friction": (
        *("forward", "backward", "bristle", "bristle_damping", "weakening", "weakening_speed"),
        *("static", "stribeck_speed", "stribeck_power", "gear"),
    ),
    "drag": (
        *("eddy", "eddy_backward", "eddy_slowness"),
        *("drag", "drag_power", "drag_speed", "drag_linear"),
        *("stall_speed", "stall_share", "band", "band_speed", "band_width"),
    ),
    "winding": (
        *("contact", "contact_current", "flux_loss", "flux_current"),
        *("inductance_loss", "inductance_current"),
        *("heat_winding", "heat_housing", "time_winding", "time_housing"),
    ),
    "supply": (
        *("source", "source_rise", "brush", "brush_current", "brush_rise"),
        *("block", "block_fall", "open", "open_fall"),
        *("current_limit", "current_contact", "speed_limit", "limiter_gain", "limiter_leak"),
        *("supply_gain", "supply_bend", "supply_bias", "supply_bias_fall"),
        *("actuator_time", "limit", "limit_sharpness", "dead", "dead_softness", "delay", "walk"),
    ),
    "load": (
        *("load", "load_growth", "load_angle", "cog", "cog_periods", "cog_phase"),
        *("cog_second", "cog_second_phase", "gravity", "gravity_phase", "gravity_second"),
        *("pulse", "pulse_rate", "pulse_phase", "window", "window_from", "window_to"),
        *("spring", "spring_rise", "spring_angle"),
        *("belt", "belt_order", "belt_phase", "hysteresis", "hysteresis_width"),
    ),
    "shaft": (
        *("far", "coupling", "coupling_cubic", "coupling_damping", "backlash", "clutch"),
        *("fluid", "fluid_time"),
    ),
    "sensor": (
        *("gain", "gain_bend", "bias", "bias_wave", "bias_rate", "lag_1", "lag_2"),
        *("encoder", "encoder_phase", "missed", "missed_speed"),
    ),
}

PLANT = np.dtype([(name, np.float64) for names in _FIELDS.values() for name in names])

CONTACT = 20.0  # Ohm, with which a drive meets its current limit, unless a law says otherwise
BRISTLE = 0.02  # rad; deflection at which the bristles slip, unless a law says otherwise


def ideal(known: Mapping[str, float]) -> Any:
    """The record of a machine that is as its file says.

    Args:
        known: parameters of the machine file by their names there.
    """
    p = np.zeros(1, PLANT)[0]
    for name in ("R", "L", "J", "b"):
        p[name] = known[name]
    p["K"] = known["K_t"]
    if "m" in known:
        p["unbalance"], p["mass"] = known["m"] * known["e"], known["m"] + known["M"]
        # What turns with the shaft: the eccentric mass adds its own moment of inertia.
        p["J"] += known["m"] * known["e"] ** 2
        for name in ("K_x", "K_y", "R_x", "R_y"):
            p[name] = known[name]
    for name in ("weakening_speed", "stribeck_speed", "contact_current", "flux_current"):
        p[name] = 1.0
    for name in (
        "inductance_current",
        "brush_current",
        "load_angle",
        "spring_angle",
        "time_winding",
    ):
        p[name] = 1.0
    for name in ("time_housing", "drag_speed", "band_width", "hysteresis_width"):
        p[name] = 1.0
    p["gain"] = p["supply_gain"] = 1.0
    p["bristle"], p["stribeck_power"], p["drag_power"] = BRISTLE, 2.0, 2.0
    p["current_contact"] = CONTACT
    p["limit"] = p["current_limit"] = p["speed_limit"] = p["stall_speed"] = np.inf
    return p
