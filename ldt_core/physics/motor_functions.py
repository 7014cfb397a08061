"""The exponential of the ideal motor's equations, and the functions of it that integrators need."""

from __future__ import annotations

import cmath

from ldt_core.base.compiled import njit

LEAST_SEPARATION = 1e-5  # of the motor's roots, below which formulas for two roots lose digits
SERIES = 0.5  # argument below which functions of the exponential are taken from their series
TERMS = 16  # of the series: exact to rounding


@njit(nogil=True)
def _functions(z):  # pragma: no cover - compiled
    """phi_0 to phi_3 of a complex number: e^z, and phi_k+1 = (phi_k - 1 / k!) / z."""
    if abs(z) < SERIES:
        term = 1 / 6 + 0j * z
        three = term
        for k in range(4, 3 + TERMS):
            term = term * z / k
            three = three + term
        two = 0.5 + z * three
        one = 1.0 + z * two
        return 1.0 + z * one, one, two, three
    power = cmath.exp(z)
    one = (power - 1.0) / z
    two = (one - 1.0) / z
    return power, one, two, (two - 0.5) / z


@njit(nogil=True)
def motor_functions(pull, drag, emf, loss, h, found):  # pragma: no cover - compiled
    """Write phi_0(h A) to phi_3(h A) into `found` (4, 2, 2); A is of speed and current.

    By interpolation between the two roots of A = [[-drag, pull], [-emf, -loss]] [1/s].

    Args:
        pull, drag, emf, loss: as in `Coefficients`.
        h: time [s].
    """
    mean, product = -(drag + loss) / 2, drag * loss + pull * emf
    half = cmath.sqrt(complex(mean * mean - product))
    if abs(half) < LEAST_SEPARATION * abs(mean):
        half = complex(LEAST_SEPARATION * abs(mean))
        fast, slow = mean - half, mean + half
    else:
        fast = mean - half
        slow = product / fast  # without cancellation
    at_fast, at_slow = _functions(fast * h), _functions(slow * h)
    for k in range(4):
        slope = (at_slow[k] - at_fast[k]) / (slow - fast)
        found[k, 0, 0] = (at_slow[k] + slope * (-drag - slow)).real
        found[k, 0, 1] = (slope * pull).real
        found[k, 1, 0] = (-slope * emf).real
        found[k, 1, 1] = (at_slow[k] + slope * (-loss - slow)).real
