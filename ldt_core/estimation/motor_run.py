"""One experiment of a discrete motor, as fits to it take it."""

from __future__ import annotations

from typing import NamedTuple

from ldt_core.base.arrays import Array


class MotorRun(NamedTuple):
    """One measured experiment and the discrete motor behind it.

    Args:
        ad, bd, gd: (2, 2), (2,), (2,) over one sample period, states current [A] and speed [rad/s]:
            itself, for the voltage, for an acceleration of the shaft.
        period: T [s].
        voltage, speed: (L,) [V], measured [rad/s].
        current: at the first sample [A].
    """

    ad: Array
    bd: Array
    gd: Array
    period: float
    voltage: Array
    speed: Array
    current: float
