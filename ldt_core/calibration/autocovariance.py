"""The autocovariance of what a fit leaves: of noise that is white, has a memory, or both at once.

A sensor's noise is often white noise on top of a slow drift. An autoregression of a finite order
forgets too soon then: of white noise and as much AR(1) noise of 0.97, it finds 4.3 of the 5.8
deviations that the sum has at the lowest frequencies. So that sum, white + AR(1), is tried beside
it. Both are judged by the likelihood that Whittle gave the periodogram, debiased: what is expected
of a periodogram of finite length takes the place of the spectrum (Sykulski, Olhede, Guillaumin,
Lilly, Early, "The debiased Whittle likelihood", Biometrika 106, 2019).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.base.arrays import Array

MOST_ORDER = 20  # of the autoregression: its memory in samples
MIXED = 2  # parameters of white + AR(1) beyond a level: its share, its memory
SHORTEST_MEMORY = 0.5  # samples: of 0.14 from one to the next, hardly other than white
MEMORIES, SHARES = 12, 9  # points of the first grid: the likelihood is smooth between them
ROUNDS = 6  # each halves the steps about the best: to 1/64 of the first
LEAST_POWER = 1e-12  # of the level: rounding of a spectrum that is 0


@dataclass(frozen=True)
class Autocovariance:
    """Of residuals, in their unit squared.

    Attributes:
        values: (longest,) from lag 0 on.
        method: in words: AR(2).
        white: whether nothing but lag 0 is there.
    """

    values: Array
    method: str
    white: bool


def autocovariance(residuals: Sequence[Array], longest: int) -> Autocovariance:
    """The autocovariance that explains residuals best, by Schwarz's criterion.

    Args:
        residuals: (L,) each, of one process.
        longest: lags to give.
    """
    values, order = _autoregression(residuals, longest)
    found = Autocovariance(values, f"AR({order})", order == 0)
    periodograms = _Periodograms(residuals)
    if not periodograms.power.any():
        return found
    mixed, deviance = _mixed(periodograms, longest)
    price = math.log(periodograms.samples)
    if deviance + MIXED * price < periodograms.deviance_of(values) + order * price:
        return Autocovariance(mixed, "white + AR(1)", False)
    return found


class _Periodograms:
    """Of all residuals, one behind the other."""

    def __init__(self, residuals: Sequence[Array]) -> None:
        self.lengths = sorted({len(r) for r in residuals})
        self.counts = [sum(len(r) == n for r in residuals) for n in self.lengths]
        ordered = sorted(residuals, key=len)
        self.power = np.concatenate([np.abs(np.fft.rfft(r)) ** 2 / len(r) for r in ordered])
        self.weight = np.concatenate([self._weights(len(r)) for r in ordered])
        self.samples = sum(map(len, residuals))

    @staticmethod
    def _weights(length: int) -> Array:
        weight = np.full(length // 2 + 1, 2.0)
        weight[0] = 1.0
        if length % 2 == 0:
            weight[-1] = 1.0
        return weight

    def expected(self, covariance: Array) -> Array:
        """What each is on average for a process with this autocovariance, (longest,)."""
        parts = []
        for length, count in zip(self.lengths, self.counts, strict=True):
            lags = (1 - np.arange(length) / length) * covariance[:length]
            one = 2 * np.fft.rfft(lags).real - covariance[0]
            parts += [np.maximum(one, LEAST_POWER * covariance[0])] * count
        return np.concatenate(parts)

    def deviance(self, shape: Array) -> tuple[Array, Array]:
        """(..., ) -2 log likelihood of spectra (..., n) at their best level, and that level."""
        level = np.sum(self.weight * self.power / shape, axis=-1) / self.samples
        return np.sum(self.weight * np.log(shape), axis=-1) + self.samples * np.log(level), level

    def deviance_of(self, covariance: Array) -> float:
        """The same of an autocovariance."""
        if len(covariance) < self.lengths[-1]:
            covariance = np.pad(covariance, (0, self.lengths[-1] - len(covariance)))
        return float(self.deviance(self.expected(covariance))[0])


def _mixed(periodograms: _Periodograms, longest: int) -> tuple[Array, float]:
    """(longest,) autocovariance of the likeliest white + AR(1), and its deviance.

    The grid is in the logarithm of the memory, and in the share of the power that has one.
    """
    length = max(longest, periodograms.lengths[-1])
    lags = np.arange(length)
    low, high = math.log(SHORTEST_MEMORY), math.log(max(length, 2 * SHORTEST_MEMORY))
    memories, shares = np.linspace(low, high, MEMORIES), np.linspace(0.0, 1.0, SHARES)
    steps = memories[1] - memories[0], shares[1] - shares[0]
    best, at = math.inf, (low, 0.0, 1.0)
    for _ in range(ROUNDS + 1):
        for memory in memories:
            slow = periodograms.expected(np.exp(-lags / math.exp(memory)))
            found, level = periodograms.deviance(1 + shares[:, None] * (slow - 1))
            k = int(np.argmin(found))
            if found[k] < best:
                best, at = float(found[k]), (float(memory), float(shares[k]), float(level[k]))
        steps = steps[0] / 2, steps[1] / 2
        near = np.array([-1.0, 0.0, 1.0])
        memories = np.clip(at[0] + steps[0] * near, low, high)
        shares = np.clip(at[1] + steps[1] * near, 0.0, 1.0)
    lasting, share, power = at
    values = power * share * np.exp(-lags[:longest] / math.exp(lasting))
    values[0] = power
    return values, best


def _autoregression(residuals: Sequence[Array], longest: int) -> tuple[Array, int]:
    """(longest,) autocovariance of the autoregression that fits the residuals, and its order."""
    samples = sum(len(r) for r in residuals)
    lags = max(1, min(MOST_ORDER, samples // 10, min(len(r) for r in residuals) - 1))
    found = np.array(
        [sum(float(r[: len(r) - k] @ r[k:]) for r in residuals) / samples for k in range(lags + 1)]
    )
    best, chosen, variance = samples * math.log(max(found[0], 1e-300)), np.zeros(0), found[0]
    weights = np.zeros(0)
    for order in range(1, lags + 1):  # Levinson-Durbin, so that each order is stable
        if variance <= 0:
            break
        reflection = (found[order] - weights @ found[order - 1 : 0 : -1]) / variance
        weights = np.append(weights - reflection * weights[::-1], reflection)
        variance *= 1 - reflection**2
        criterion = samples * math.log(max(variance, 1e-300)) + math.log(samples) * order
        if criterion < best:
            best, chosen = criterion, weights.copy()
    full = np.zeros(max(longest, lags + 1))
    full[: lags + 1] = found
    if not chosen.size:
        full[1:] = 0.0
        return full[:longest], 0
    for k in range(chosen.size + 1, full.size):
        full[k] = chosen @ full[k - 1 : k - 1 - chosen.size : -1]
    return full[:longest], chosen.size
