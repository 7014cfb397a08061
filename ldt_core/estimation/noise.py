"""What a measured signal and a residual say of their noise."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from ldt_core.base.arrays import Array

THIRD_DIFFERENCE = math.sqrt(20)  # standard deviation of that of white noise with deviation 1
NORMAL_MEDIAN = 0.6745  # of the size of a standard normal number
FEWEST_SAMPLES = 4  # for a third difference, or for a pair of lags


def white_noise(signals: Iterable[Array]) -> float:
    """Deviation of white noise on smooth signals, in their unit, from third differences.

    Their median, so that steps of a signal do not count; 0 where all signals have fewer than 4
    samples.

    Args:
        signals: (L,) each.
    """
    parts = [np.abs(np.diff(s, 3)) for s in signals if len(s) >= FEWEST_SAMPLES]
    if not parts:
        return 0.0
    return float(np.median(np.concatenate(parts))) / NORMAL_MEDIAN / THIRD_DIFFERENCE


def correlation_time(residual: Array) -> float:
    """Samples of white noise that tell as much as one of this residual (L,), at least 1.

    1 + 2 sum of autocorrelations, while sums of neighbouring pairs are positive (Geyer, "Practical
    Markov chain Monte Carlo", Statistical Science 7, 1992), up to half the length.
    """
    length = residual.size
    if length < FEWEST_SAMPLES:
        return 1.0
    spectrum = np.abs(np.fft.rfft(residual, 2 * length)) ** 2
    correlation = np.fft.irfft(spectrum)[: length // 4 * 2]
    if correlation[0] <= 0:
        return 1.0
    return _initial_positive_sum(correlation.reshape(-1, 2).sum(axis=1) / correlation[0])


def common_correlation_time(residuals: Sequence[Array]) -> float:
    """The same for several residuals (L,) of one process, over all lags.

    It divides the covariances before they are summed up, and pads to a power of two.
    """
    longest = max(r.size for r in residuals)
    size = 2 ** int(np.ceil(np.log2(2 * longest)))
    power = sum(np.abs(np.fft.rfft(r, size)) ** 2 for r in residuals)
    covariance = np.fft.irfft(power, size)[:longest]
    if not covariance[0] > 0:
        return 1.0
    correlation = covariance / covariance[0]
    return _initial_positive_sum(correlation[: longest // 2 * 2].reshape(-1, 2).sum(axis=1))


def _initial_positive_sum(pairs: Array) -> float:
    negative = np.flatnonzero(pairs <= 0)
    return max(1.0, 2 * float(pairs[: negative[0] if negative.size else None].sum()) - 1.0)


def roughness(samples: Array) -> float:
    """Standard deviation of the white part of (L,) samples, from differences of neighbours.

    Half the mean squared difference: von Neumann, Annals of Mathematical Statistics 12 (1941).
    What changes slowly against the sample period does not count; 0 for fewer than 2 samples.
    """
    if samples.size < 2:
        return 0.0
    return math.sqrt(0.5 * float(np.mean(np.diff(samples) ** 2)))
