"""Smoothing, tapers and spectra are those of scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter, periodogram, savgol_coeffs, savgol_filter
from scipy.signal.windows import tukey

from ldt_core.estimation.smoothing import (
    cosine_taper,
    polynomial_weights,
    power_density,
    smoothed,
)
from ldt_core.physics.integrate import answered

SIGNAL = np.random.default_rng(1).normal(size=400).cumsum()


@pytest.mark.parametrize("derivative", [0, 1])
@pytest.mark.parametrize("window", [5, 31, 399])
def test_smoothing_polynomials(window, derivative):
    expected = savgol_coeffs(window, 2, deriv=derivative, delta=0.01)
    np.testing.assert_allclose(polynomial_weights(window, 2, derivative, 0.01), expected, atol=1e-9)
    expected = savgol_filter(SIGNAL, window, 2, deriv=derivative, delta=0.01)
    found = smoothed(SIGNAL, window, 2, derivative, 0.01)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("length", [1, 2, 7, 100, 2000])
def test_taper(length):
    np.testing.assert_allclose(cosine_taper(length, 0.2), tukey(length, 0.2), atol=1e-12)


@pytest.mark.parametrize("length", [9, 10, 399, 400])
def test_spectrum(length):
    expected = periodogram(SIGNAL[:length], 100.0, "hann", detrend="constant")
    for found, one in zip(power_density(SIGNAL[:length], 0.01), expected, strict=True):
        np.testing.assert_allclose(found, one, rtol=1e-9, atol=1e-12)


def test_answer_goes_on_where_it_was():
    rows = np.random.default_rng(2).normal(size=(50, 3))
    expected = lfilter([0.0, 0.3], [1.0, -0.9], rows, axis=0)
    kept = np.zeros(3)
    found = [answered(part, 0.9, 0.3, kept) for part in (rows[:20], rows[20:])]
    np.testing.assert_allclose(np.concatenate(found), expected, atol=1e-12)
