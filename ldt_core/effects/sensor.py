"""What the speed sensor makes of the speed."""

from __future__ import annotations

import math

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.units import UNITS
from ldt_core.effects.base import Effect, factor_of
from ldt_core.physics.parameter import Parameter

#: What rad/s are in revolutions per second, rpm, and degrees per second: a display set to these.
OTHER_UNITS = tuple(1 / UNITS["speed"][unit] for unit in ("rps", "rpm", "deg/s"))


def _lagging(speed: Array, period: float, time_constant: float) -> Array:
    """Exact for a speed that is linear between samples; settled at the first one."""
    if time_constant < period * 1e-6:  # the filter's formula cancels there, and does nothing
        return speed
    ratio = period / time_constant
    decay = math.exp(-ratio)
    gain = -math.expm1(-ratio) / ratio
    now, before = 1.0 - gain, gain - decay
    # With its compiler it takes longer to import than all else of an effect.
    from ldt_core.physics.integrate import lagged

    return lagged(np.ascontiguousarray(speed, dtype=np.float64), decay, now, before)


SENSOR_GAIN = Effect(
    name="sensor_gain",
    family="calibration",
    description="the sensor shows a multiple of the speed",
    equation="measured = factor omega",
    parameters=(factor_of("of the speed"),),
    typical={"factor": 1.05},
    on_measurement=lambda speed, period, factor: speed * factor,
    most_factor=100.0,
    search={"factor": (0.5, 0.8, 1.25, 2.0, *OTHER_UNITS)},
    reference="Doebelin, Measurement Systems, chapter 3 (static sensitivity)",
)

SENSOR_BIAS = Effect(
    name="sensor_bias",
    family="calibration",
    description="the sensor has the same offset at every speed",
    equation="measured = omega + bias",
    parameters=(Parameter("bias", "rad/s", default=0.0, description="either sign", scale=1.0),),
    typical={"bias": 1.0},
    on_measurement=lambda speed, period, bias: speed + bias,
    reference="Doebelin, Measurement Systems, chapter 3 (bias)",
)

SENSOR_LAG = Effect(
    name="sensor_lag",
    family="lag",
    description="the sensor is slow: a filter of first order, settled at the first sample",
    equation="tau measured' = omega - measured",
    parameters=(Parameter("time_constant", "s", 0.0, default=0.0, description="tau", scale=0.05),),
    typical={"time_constant": 0.05},
    search={"time_constant": (0.01, 0.03, 0.1, 0.3)},
    on_measurement=_lagging,
    reference="Doebelin, Measurement Systems, chapter 3 (first-order instrument)",
)
