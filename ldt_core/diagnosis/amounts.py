"""How well a set's parameters are known: intervals of a fit whose laws are not exactly right.

Noise alone would give the covariance (J'J)^-1. But no candidate's law is exactly the machine's: a
structured remainder R, in the same units, shows how far off they are where the parameters cannot
follow, and what is off where they can is as likely of the same size in each direction. A remainder
of some DIRECTIONS independent shapes adds R / DIRECTIONS to the variance of each. Where nothing
structured is left, the law may still be off in just the way that its parameters can follow: LEAST
of the gap's power is taken to be so.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ldt_core.diagnosis.candidate import turning
from ldt_core.diagnosis.result import Amount
from ldt_core.diagnosis.search import Fit

Array = NDArray[np.float64]

NORMAL = 1.96  # deviations of a 95 % interval
DIRECTIONS = 3.0  # independent shapes that a remainder consists of
LEAST = 0.005  # of the gap's power, by which a law is off without a trace
UNKNOWN = 3.0  # coordinates: a parameter known no better than this is not determined


def deviations(fit: Fit, left: float, gap: float) -> tuple[Array, ...]:
    """Standard deviation of each member's coordinates; infinite where nothing depends on them.

    Args:
        fit: the set.
        left: power that it leaves beyond noise.
        gap: power of the whole gap.
    """
    size = np.linalg.norm(fit.jacobian, axis=0)
    seen = size > 1e-9
    found = np.full(size.size, math.inf)
    if seen.any():
        scaled = fit.jacobian[:, seen] / size[seen]
        _, s, right = np.linalg.svd(scaled, full_matrices=False)
        variance = np.sum((right.T / np.maximum(s, 1e-7)) ** 2, axis=1) / size[seen] ** 2
        found[seen] = np.sqrt(variance * (1 + (max(left, 0.0) + LEAST * gap) / DIRECTIONS))
    edges = np.cumsum([len(c) for c in fit.members])[:-1]
    return tuple(np.split(found, edges))


def amounts(fit: Fit, left: float, gap: float) -> dict[str, dict[str, Amount]]:
    """Effect to parameter to amount, of every member of a set; arguments as of `deviations`."""
    found: dict[str, dict[str, Amount]] = {}
    for c, z, spread in zip(fit.effects, fit.z, deviations(fit, left, gap), strict=False):
        low, high = c.bounds
        own = {}
        for j, p in enumerate(c.parameters):
            interval = None
            if spread[j] < UNKNOWN:
                ends = np.clip(z[j] + NORMAL * spread[j] * np.array([-1, 1]), low[j], high[j])
                interval = c.value(j, float(ends[0])), c.value(j, float(ends[1]))
                if turning(p):  # of which an end may lie beyond the range
                    half, value = NORMAL * spread[j] * c.scale(j), c.value(j, float(z[j]))
                    interval = value - half, value + half
            own[p.name] = Amount(c.value(j, float(z[j])), p.unit, interval)
        found[c.name] = own
    return found
