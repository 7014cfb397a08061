"""A control chart of standard normal values: a limit for each, and one for what they add up to."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri

#: Half the lasting shift, in standard deviations, that the cumulative sum finds soonest.
ALLOWANCE = 0.5
#: States of the chain that stands for the cumulative sum. 100, 150 and 400 give run lengths that
#: agree to 0.15 % at 4900.
STATES = 150
#: State in which the sum begins again after a positive: half its limit.
AGAIN = STATES // 2
#: Decimals of the limits: their error is larger, and they are the same whatever the processor.
DECIMALS = 3
#: [standard deviations] Limits of the cumulative sum between which one is sought: run lengths from
#: 5 to more than any machine has experiments.
LIMIT_RANGE = (1e-3, 60.0)
#: Largest share of values that may be warnings.
MOST_WARNINGS = 0.2


@functools.cache
def limits(run_length: float) -> tuple[float, float]:
    """(limit of a value, limit of the sum) of a chart that is in control for so long on average.

    The values z_i are standard normal and independent, C_i = max(0, C_{i-1} + z_i - 1/2), and the
    chart is positive when z_i or C_i is above its limit. A single value is above its own once in
    twice the run length; the sum's limit makes up the rest. After a positive C begins again at half
    its limit, so that what has not been mended is soon positive again.

    Args:
        run_length: mean number of values from one positive to the next, from 5.

    >>> limits(1000)
    (3.291, 5.709)
    """
    single = float(ndtri(1 - 0.5 / run_length))

    def excess(log_total: float) -> float:
        return math.log(average_run_length(single, math.exp(log_total)) / run_length)

    total = math.exp(brentq(excess, *np.log(LIMIT_RANGE), xtol=1e-6))
    return round(single, DECIMALS), round(total, DECIMALS)


@functools.cache
def warning_limits(run_length: float, share: float) -> tuple[float, float]:
    """(limit of a value, limit of the sum) that so large a share of the values is above.

    Args:
        run_length: of the chart, whose sum begins again after a positive.
        share: of values above one of the limits, positives included.
    """
    share = min(share, MOST_WARNINGS)
    centres, stays = markov_chain(*limits(run_length))
    moves = stays.copy()
    moves[:, AGAIN] += 1 - stays.sum(axis=1)
    equations = np.vstack([moves.T - np.eye(STATES), np.ones(STATES)])
    long_run = np.linalg.lstsq(equations, np.append(np.zeros(STATES), 1.0), rcond=None)[0]
    single = float(ndtri(1 - 0.5 * share))

    def excess(total: float) -> float:
        least = np.minimum(single, total + ALLOWANCE - centres)
        return float(long_run @ ndtr(-least)) - share

    total = float(brentq(excess, -10.0, LIMIT_RANGE[1], xtol=1e-6))
    return round(single, DECIMALS), round(total, DECIMALS)


def average_run_length(single: float, total: float) -> float:
    """Mean number of values from one positive to the next.

    Args:
        single: limit of a value.
        total: limit of the sum.

    References:
        Brook, Evans: An approach to the probability distribution of CUSUM run length,
        Biometrika 59 (1972).
        Lucas, Crosier: Fast initial response for CUSUM quality-control schemes, Technometrics 24
        (1982).
    """
    _, stays = markov_chain(single, total)
    return float(np.linalg.solve(np.eye(STATES) - stays, np.ones(STATES))[AGAIN])


def markov_chain(single: float, total: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(sums (n,), probabilities (n, n) of going from one to the other without a positive)."""
    width = 2 * total / (2 * STATES - 1)  # the first state is the sum 0, and half as wide
    centres = np.asarray(width * np.arange(STATES), dtype=np.float64)
    edges = np.concatenate([[-np.inf], width * (np.arange(STATES) + 0.5)])
    steps = np.minimum(edges[None, :] - centres[:, None] + ALLOWANCE, single)
    return centres, np.asarray(np.diff(ndtr(steps), axis=1))
