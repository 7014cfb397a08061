"""How much of a residual is more than noise.

The sensors' noise is taken to be white; what a machine does wrong lies at low frequencies, where
its inertia lets anything show at all. So the power below a limit is compared with that above it:
the difference has far less scatter than the whole sum of squares, and needs no noise level that
somebody has to state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import betaincinv

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import rms
from ldt_core.diagnosis.channel_noise import noise_floor
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.estimation.noise import roughness
from ldt_core.estimation.smoothing import cosine_taper

TAPER = 0.2  # share of an experiment, both ends together: keeps strong low frequencies from leaking
MEDIAN_VARIANCE = 2.1  # variance of the median of exponential powers over that of their mean
DIFFERENCE_VARIANCE = 4.6  # of a power by third differences' median over that of the mean square

#: Deviations by which von Neumann's ratio of white noise may be low: 1 in 740 is lower.
WHITE = 3.0


class ErrorBand:
    """The low frequencies of residuals, in which the errors of a machine lie."""

    def __init__(self, residuals: FreeRunResiduals) -> None:
        self.residuals = residuals
        fastest = max((float(np.abs(e.speed).max()) for e in residuals.experiments), default=0.0)
        motor = THRESHOLDS.error_bandwidths / residuals.memory
        #: Upper limit of the band [Hz].
        self.limit = max(motor, THRESHOLDS.error_orders * fastest) / (2 * math.pi)
        self._rows: list[tuple[int, int, slice]] = []  # experiment, channel, rows
        unknown = 0
        for i, piece in enumerate(residuals.pieces):
            unknown += residuals.starts.bases[i].shape[1]
            self._rows += [(i, channel, rows) for channel, rows in enumerate(piece.channels)]
        #: Degrees of freedom of the band in each channel.
        self.free = [0.0, 0.0]
        #: Degrees of freedom of each frequency of an experiment, in the band and above it.
        self._low = [self._in_band(i) for i in range(len(residuals.pieces))]
        self._high = [self._above(i) for i in range(len(residuals.pieces))]
        for i, channel, _ in self._rows:
            self.free[channel] += float(np.sum(self._low[i]))
        self.free[0] -= unknown
        #: What the noise of each channel is, in the deviations that the residuals are divided by.
        self.level = residuals.level
        self.above = sum(float(np.sum(self._high[i])) for i, _, _ in self._rows)

    @property
    def noise(self) -> float:
        """Power of the band when there is noise alone."""
        return sum(f * size**2 for f, size in zip(self.free, self.level, strict=True))

    @property
    def samples(self) -> int:
        """Of all channels that were measured."""
        return self.residuals.size

    def _frequency(self, i: int) -> Array:
        e = self.residuals.experiments[i]
        return np.asarray(np.fft.rfftfreq(len(e), e.period), dtype=np.float64)

    def _in_band(self, i: int) -> Array:
        e, frequency = self.residuals.experiments[i], self._frequency(i)
        count = np.full(frequency.size, 2.0)
        count[0] = 1.0
        if len(e) % 2 == 0:
            count[-1] = 1.0
        return np.where(frequency <= self.limit, count, 0.0)

    def _above(self, i: int) -> Array:
        count = np.where(self._frequency(i) > THRESHOLDS.noise_band_start * self.limit, 2.0, 0.0)
        return count if np.count_nonzero(count) >= THRESHOLDS.noise_frequencies else 0.0 * count

    def power(self, rest: Array, speed: bool = False) -> Array:
        """(experiments,) power of (size,) residuals in the band, noise included."""
        found = np.zeros(len(self.residuals.pieces))
        for i, channel, rows in self._rows:
            if speed and channel:
                continue
            found[i] += float(self._low[i] @ _periodogram(rest[rows]))
        return found

    def excess(self, rest: Array) -> float:
        """Power beyond that of white noise; about 0 for a right model."""
        return float(self.power(rest).sum()) - self.noise

    def speed_excess(self, rest: Array) -> float:
        """The same of the speed alone."""
        noise = self.free[0] * self.level[0] ** 2
        return float(self.power(rest, speed=True).sum()) - noise

    def current_excess(self, rest: Array) -> float:
        """The same of the current alone; 0 where it was not measured."""
        return self.excess(rest) - self.speed_excess(rest)

    def current_gain(self, before: Array, after: Array) -> float:
        """Loss in the current that the step from some residuals to others takes away."""
        return float(before @ before - after @ after) - self.speed_gain(before, after)

    def speed_loss(self, rest: Array) -> Array:
        """(experiments,) sum of squares of the speed's residuals."""
        found = np.zeros(len(self.residuals.pieces))
        for i, channel, rows in self._rows:
            if not channel:
                found[i] += float(rest[rows] @ rest[rows])
        return found

    def speed_gain(self, before: Array, after: Array) -> float:
        """Loss in the speed that the step from some residuals to others takes away."""
        return float((self.speed_loss(before) - self.speed_loss(after)).sum())

    def speed_gap(self, base: Array, residual: Array) -> float:
        """Power of the gap in the speed: what a set explains, and what it leaves.

        The speed alone, since it is what is to be predicted. A current that was measured well
        shows how the laws differ from the machine's long before that matters.

        Args:
            base: (size,) residuals without any effect.
            residual: (size,) residuals with the set.
        """
        explained, left = self.speed_gain(base, residual), self.speed_excess(residual)
        return max(explained, 0.0) + max(left, 0.0)

    def channel_noise(self, rest: Array) -> tuple[float, float]:
        """What the noise of speed and current is, in the deviations assumed: from above the band.

        It is at most `noise_level_change` times what the measured signals say, and may be far
        less: to them, a ripple of the shaft that is quick against the sample period looks like
        noise. Where steps of a sensor repeat, it is what they say. Where nothing lies above the
        band, the residual's roughness tells it; all of one that is white is noise, by whatever law.
        """
        power: tuple[list[Array], list[Array]] = ([], [])
        parts: tuple[list[Array], list[Array]] = ([], [])
        for i, channel, rows in self._rows:
            part, seen = rest[rows], self._high[i] > 0
            window = cosine_taper(part.size, TAPER)
            window /= rms(window)
            power[channel].append(_periodogram(part * window)[seen])
            parts[channel].append(part)
        r = self.residuals
        least = noise_floor(r.experiments)  # a smooth error has nothing above the band
        first, second = (
            max(_noise_of(p, high, known), floor / size) if p and white == 1.0 else known
            for p, high, known, white, floor, size in zip(
                parts, power, r.level, r.whiteness, least, r.noise, strict=True
            )
        )
        return first, second

    def limit_of(self, chance: float) -> float:
        """Excess that noise alone passes with this probability, its level judged from above."""
        return self._limit(chance, self.noise, sum(self.free))

    def speed_limit(self, chance: float) -> float:
        """Of the speed alone."""
        return self._limit(chance, self.free[0] * self.level[0] ** 2, self.free[0])

    def current_limit(self, chance: float) -> float:
        """Of the current alone, where it was measured."""
        return self._limit(chance, self.free[1] * self.level[1] ** 2, self.free[1])

    def _limit(self, chance: float, noise: float, free: float) -> float:
        # Without a frequency above the band, noise is as uncertain as third differences tell it.
        above = self.above / MEDIAN_VARIANCE if self.above else free / DIFFERENCE_VARIANCE
        # The ratio of such powers that is exceeded by this chance (Fisher's distribution).
        part = float(betaincinv(above / 2, free / 2, chance))
        return noise * (above * (1 - part) / (free * part) - 1)


def _noise_of(parts: Sequence[Array], above: Sequence[Array], known: float) -> float:
    """Deviation of the noise in a channel's residuals, from their powers above the band if any."""
    seen, most = np.concatenate(above), THRESHOLDS.noise_level_change * known
    if seen.size:  # the median, so that a ripple which sweeps through some of them does not count
        return min(math.sqrt(float(np.median(seen)) / math.log(2)), most)
    whole, rough = rms(np.concatenate(parts)), rms(np.array([roughness(p) for p in parts]))
    chance = WHITE / math.sqrt(sum(p.size for p in parts))
    return rough if rough**2 >= (1 - chance) * whole**2 else min(rough, most)


def _periodogram(part: Array) -> Array:
    """1 on average at each frequency for white noise of deviation 1."""
    spectrum = np.fft.rfft(part)
    return np.asarray((spectrum.real**2 + spectrum.imag**2) / part.size)
