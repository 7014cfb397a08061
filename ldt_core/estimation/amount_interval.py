"""How well an effect's amount is known: by noise, and by how far off its law may be.

A structured remainder R shows how far off the laws are where the parameters cannot follow; of
`REMAINDER_SHAPES` independent shapes, it adds its share of R to the variance of each. Where the
parameters can follow, `TRACELESS_ERROR` stands for it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import rms

if TYPE_CHECKING:
    from ldt_core.estimation.fitted_structure import FittedStructure

DEVIATIONS = 1.96  # half width of a 95 % interval of a normal distribution
REMAINDER_SHAPES = 3.0  # independent shapes that a remainder is taken to consist of
TRACELESS_ERROR = 0.005  # of the gap's power, by which a law may be off and leave no remainder
#: Of that variance, what amounts show of it: those of 60 sealed cases were off by 0.37 deviations
#: with all of it (root mean square of 54, 0.92 at most), and by 0.75 with a quarter.
SHOWN = 0.25
UNDETERMINED = 3.0  # standard deviation, in coordinates, from which a parameter has no interval


def law_variance(left: float, gap: float) -> float:
    """Variance of the data, in that of the noise, with what the laws are off by.

    A set leaves the power `left` beyond noise, of the power `gap` of the whole gap.
    """
    return 1 + (max(left, 0.0) + TRACELESS_ERROR * max(gap, 0.0)) / REMAINDER_SHAPES


def shown_variance(left: float, gap: float) -> float:
    """What amounts show of it; arguments as of `law_variance`."""
    return 1 + SHOWN * (law_variance(left, gap) - 1)


def has_interval(spread: Array, amount: Array) -> NDArray[np.bool_]:
    """(n,) whether coordinates of such standard deviations are known well enough to be told.

    Args:
        spread: (n,) standard deviations.
        amount: (n,) coordinates of amounts, and 0 of others: one far from none is known, however
            wide its interval.
    """
    return (spread < UNDETERMINED) | (DEVIATIONS * spread < np.abs(amount))


def intervals_of(found: FittedStructure, told: Array) -> dict[str, dict[str, list[float] | None]]:
    """Effect to parameter to the ends of its 95 % interval; None where nothing determines it.

    By what the fit was made to and the machine file: what earlier fits told of the machine holds
    only if it has not changed since. The gap is what the effects explain that the machine's own
    parameters cannot, to first order.

    Args:
        found: machine with effects.
        told: (n, n) information on its coordinates for white noise, without any prior.
    """
    box, fit, k = found.box, found.fit, len(found.box.uncertain)
    rest, noise, prior = np.concatenate(fit.residuals), max(fit.noise, 1e-12), np.zeros_like(told)
    prior[:k, :k] = np.eye(k)
    prior += 1e-9 * np.eye(box.size)
    left = rest.size * (rms(rest) ** 2 / noise**2 - 1)
    much = k + np.flatnonzero(box.amounts)
    of_amounts = _inverse(_inverse(told + prior)[np.ix_(much, much)])
    gap = float(fit.q[much] @ of_amounts @ fit.q[much])
    information = told / shown_variance(left, gap) + prior
    variance = np.diag(_inverse(information))
    spread = np.sqrt(np.where(variance > 0, variance, np.inf))  # below 0 by rounding
    amount = np.zeros(box.size)
    amount[much] = fit.q[much]
    known = has_interval(spread, amount)
    half = DEVIATIONS * np.where(known, spread, 0.0)
    ends = [box.values(fit.q + side * half)[1] for side in (-1, 1)]
    determined = iter(known[k:].tolist())
    return {
        e.name: {n: [low[n], high[n]] if next(determined) else None for n in low}
        for (e, low), (_, high) in zip(*ends, strict=True)
    }


def _inverse(matrix: Array) -> Array:
    """Of a positive definite one; coordinates of any sizes."""
    size = np.sqrt(np.abs(np.diag(matrix)))  # below 0 by rounding
    return np.linalg.inv(matrix / np.outer(size, size)) / np.outer(size, size)
