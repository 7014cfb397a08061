"""Smoothing polynomials, tapers and spectra: the few of `scipy.signal` that are needed here.

Importing that takes 0.4 s, a tenth of a diagnosis; `tests/core/test_smoothing.py` compares.
"""

from __future__ import annotations

import math

import numpy as np

from ldt_core.base.arrays import Array


def polynomial_weights(window: int, degree: int, derivative: int, period: float) -> Array:
    """(window,) weights, to convolve with, of a polynomial's value or derivative in the middle.

    The polynomial is fitted to an odd number of samples (Savitzky, Golay, Analytical Chemistry 36,
    1964, 1627).
    """
    at = np.arange(window // 2, -(window // 2) - 1, -1.0)
    wanted = np.zeros(degree + 1)
    wanted[derivative] = math.factorial(derivative) / period**derivative
    return np.asarray(np.linalg.lstsq(at ** np.arange(degree + 1)[:, None], wanted)[0])


def smoothed(signal: Array, window: int, degree: int, derivative: int, period: float) -> Array:
    """(L,) polynomial through an odd window about each sample, or its derivative.

    Near the ends it is that of the first and of the last window.
    """
    found = np.convolve(signal, polynomial_weights(window, degree, derivative, period), "same")
    half, at = window // 2, np.arange(window)
    for samples, places in (
        (slice(window), slice(half)),
        (slice(-window, None), slice(-half, None)),
    ):
        fitted = np.polyder(np.polyfit(at, signal[samples], degree), derivative)
        found[places] = np.polyval(fitted, at[places]) / period**derivative
    return found


def cosine_taper(length: int, share: float) -> Array:
    """(length,) 1 in the middle, and a share of it, both ends together, down to 0 (Tukey)."""
    if length == 1:
        return np.ones(1)
    along = np.minimum(np.arange(length), np.arange(length)[::-1]) / (length - 1)
    return 0.5 * (1.0 - np.cos(2 * math.pi * np.minimum(along / share, 0.5)))


def power_density(signal: Array, period: float) -> tuple[Array, Array]:
    """(frequency [Hz], one-sided density [unit^2/Hz]) by Hann's window, the mean removed."""
    count = signal.size
    window = 0.5 - 0.5 * np.cos(2 * math.pi * np.arange(count) / count)
    lines = np.fft.rfft((signal - signal.mean()) * window)
    power = np.abs(lines) ** 2 * period / float(window @ window)
    power[1 : (count + 1) // 2] *= 2.0  # all but 0 and half the sampling frequency stand for two
    return np.asarray(np.fft.rfftfreq(count, period), dtype=np.float64), power
