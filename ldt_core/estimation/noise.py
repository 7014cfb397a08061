"""What a measured signal and a residual say of their noise."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ldt_core.base.arrays import Array

THIRD_DIFFERENCE = math.sqrt(20)  # standard deviation of that of white noise with deviation 1
NORMAL_MEDIAN = 0.6745  # of the size of a standard normal number
NORMAL_NINTH = 1.6449  # which nine of ten are below
FEWEST_SAMPLES = 4  # for a third difference, or for a pair of lags
ROUNDING = 1 / math.sqrt(12)  # deviation of a uniform error, of the step to which it is rounded
#: Times the noise that is known: a healthy sensor's does not grow so.
ROUGHER = 3.0
#: Chance that the noise of an experiment is beyond that of those before, before `ROUGHER` counts:
#: as beyond three standard deviations.
BEYOND = 1 / 740
MOST_LOG = 300.0  # of a noise that is still a number
# A sensor's step, from the values that it shows.
RECURRENCE = 1.5  # samples for each distinct value: of a signal without steps each value is its own
FEWEST_STEPS = 4  # between distinct values, to tell a step
SAME_VALUE = 1e-6  # of the signals' range: values nearer to each other are one, in other units
USUAL_STEP = 0.05  # quantile of the differences of distinct values: a fast signal leaves many out
LESSER_STEP, FEW = 0.7, 0.01  # of that quantile, and the share of differences that may lie below


def white_noise(signals: Iterable[Array]) -> float:
    """Deviation of white noise on smooth signals, in their unit, from third differences.

    Their median, so that steps of a signal do not count; 0 where all signals have fewer than 4
    samples. Not less than what a sensor with steps rounds off (Widrow, Kollar, "Quantization
    noise", 2008): most differences of a coarse one are 0.

    Args:
        signals: (L,) each.
    """
    known = list(signals)
    return noise_beside_steps(known, sensor_step(known))


def noise_beside_steps(signals: Sequence[Array], step: float) -> float:
    """The same of signals of which the sensor's step is known, in their unit."""
    parts = [np.abs(np.diff(s, 3)) for s in signals if len(s) >= FEWEST_SAMPLES]
    if not parts:
        return 0.0
    found = float(np.median(np.concatenate(parts))) / NORMAL_MEDIAN / THIRD_DIFFERENCE
    return max(found, ROUNDING * step)


def sensor_step(signals: Sequence[Array]) -> float:
    """The step to which a sensor rounds, in the signals' unit; 0 of one that shows none.

    The smallest difference of distinct values that occurs throughout. The values of a sensor with
    steps recur, and are hardly ever nearer to each other than a step.

    Args:
        signals: (L,) each, of one sensor.
    """
    shown = np.sort(np.concatenate([np.zeros(0), *signals]))
    if not shown.size or not np.isfinite(shown[[0, -1]]).all():
        return 0.0
    apart = np.diff(shown)
    apart = apart[apart > SAME_VALUE * (shown[-1] - shown[0])]
    if apart.size < FEWEST_STEPS or RECURRENCE * apart.size > shown.size:
        return 0.0
    usual = float(np.quantile(apart, USUAL_STEP))
    return usual if np.mean(apart < LESSER_STEP * usual) <= FEW else 0.0


def rounding_correlation(signals: Sequence[Array], step: float, deviation: float) -> float:
    """Samples of white noise that tell as much as one of a sensor with steps, at least 1.

    What rounding adds is white only where noise carries the signal over half a step or more
    (Widrow, Kollar, section 4). A slower signal stays on one side of its value for as long as it
    stays between two steps.

    Args:
        signals: (L,) each, as they would be without noise and steps.
        step: to which the sensor rounds, in their unit.
        deviation: of noise and rounding together, in their unit.
    """
    own = math.sqrt(max(deviation**2 - (ROUNDING * step) ** 2, 0.0))
    if own >= step / 2:  # of a step 0, too
        return 1.0
    random = np.random.default_rng(0)
    errors = []
    for s in signals:  # where a signal lies between two steps is chance
        offset = s + step * random.random()
        noise = own * random.standard_normal(s.size)
        errors.append(np.round((offset + noise) / step) * step - offset)
    return common_correlation_time(errors)


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


class UsualNoise(NamedTuple):
    """Noise of the experiments so far, whose logarithms are taken as normal.

    Attributes:
        experiments: how many.
        mean: of the logarithms of their noise.
        squares: sum of the squared distances from it.
    """

    experiments: float = 0.0
    mean: float = 0.0
    squares: float = 0.0

    def with_one(self, noise: float) -> UsualNoise:
        """With one more experiment's, above 0 (Welford, Technometrics 4, 1962)."""
        away = math.log(noise) - self.mean
        mean = self.mean + away / (self.experiments + 1)
        return UsualNoise(
            self.experiments + 1, mean, self.squares + away * (math.log(noise) - mean)
        )

    @property
    def most(self) -> float:
        """`ROUGHER` times the upper prediction limit of the next one's; infinite before two."""
        if self.experiments < 2:
            return math.inf
        from scipy.special import stdtrit  # 30 ms to import, where nothing else needs it

        far = float(stdtrit(self.experiments - 1, 1 - BEYOND))
        spread = math.sqrt(
            max(self.squares, 0.0) / (self.experiments - 1) * (1 + 1 / self.experiments)
        )
        return ROUGHER * math.exp(min(self.mean + far * spread, MOST_LOG))


def roughness(samples: Array) -> float:
    """Standard deviation of the white part of (L,) samples, from differences of neighbours.

    Half the mean squared difference: von Neumann, Annals of Mathematical Statistics 12 (1941).
    What changes slowly against the sample period does not count; 0 for fewer than 2 samples.
    """
    if samples.size < 2:
        return 0.0
    return math.sqrt(0.5 * float(np.mean(np.diff(samples) ** 2)))
