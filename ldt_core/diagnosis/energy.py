"""How much of a residual is more than noise.

The sensors' noise is taken to be white; what a machine does wrong lies at low frequencies, where
its inertia lets anything show at all. So the power below a limit is compared with that above it:
the difference has far less scatter than the whole sum of squares, and needs no noise level that
somebody has to state.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal.windows import tukey
from scipy.stats import f as fisher

from ldt_core.diagnosis.bench import Bench

Array = NDArray[np.float64]

BANDWIDTHS = 10.0  # of the motor: the band in which its errors lie
ABOVE = 2.0  # times that band's limit, begins what counts as noise alone
TAPER = 0.2  # of an experiment, at both ends together
LEAST_ABOVE = 20  # frequencies of an experiment there; with fewer, the noise is not judged anew


class Band:
    """The low frequencies of a bench's residuals.

    Args:
        bench: whose experiments give lengths and periods.
    """

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.limit = BANDWIDTHS / (2 * math.pi * bench.memory)  # Hz
        self._rows: list[tuple[int, int, slice]] = []  # experiment, channel, rows
        unknown = 0
        for i, piece in enumerate(bench.pieces):
            length = len(piece.experiment)
            unknown += piece.basis.shape[1]
            for channel, begin in enumerate(range(piece.rows.start, piece.rows.stop, length)):
                self._rows.append((i, channel, slice(begin, begin + length)))
        low = [float(np.sum(self._low(i))) for i, _, _ in self._rows]
        #: Degrees of freedom of the band: its power when there is noise alone.
        self.noise = sum(low) - unknown
        #: What the noise of each channel is, in the deviations that the bench assumes.
        self.level = (1.0, 1.0)
        self.above = sum(float(np.sum(self._high(i))) for i, _, _ in self._rows)

    def _frequency(self, i: int) -> Array:
        e = self.bench.experiments[i]
        return np.fft.rfftfreq(len(e), e.period)

    def _low(self, i: int) -> Array:
        """Degrees of freedom of each frequency, 0 outside the band."""
        e, frequency = self.bench.experiments[i], self._frequency(i)
        count = np.full(frequency.size, 2.0)
        count[0] = 1.0
        if len(e) % 2 == 0:
            count[-1] = 1.0
        return np.where(frequency <= self.limit, count, 0.0)

    def _high(self, i: int) -> Array:
        count = np.where(self._frequency(i) > ABOVE * self.limit, 2.0, 0.0)
        return count if np.count_nonzero(count) >= LEAST_ABOVE else 0.0 * count

    def power(self, rest: Array) -> Array:
        """(experiments,) power of (size,) residuals in the band, noise included."""
        found = np.zeros(len(self.bench.pieces))
        for i, channel, rows in self._rows:
            power = float(self._low(i) @ _periodogram(rest[rows]))
            found[i] += power / self.level[channel] ** 2
        return found

    def excess(self, rest: Array) -> float:
        """Power beyond that of white noise; about 0 for a right model."""
        return float(self.power(rest).sum()) - self.noise

    def channel_noise(self, rest: Array) -> tuple[float, float]:
        """What the noise of speed and current is, in the deviations assumed: from above the band.

        1 for a channel that has nothing there.
        """
        power, count = [0.0, 0.0], [0.0, 0.0]
        for i, channel, rows in self._rows:
            weight, part = self._high(i), rest[rows]
            window = tukey(part.size, TAPER)  # keeps the strong low frequencies from leaking up
            window /= math.sqrt(float(np.mean(window**2)))
            power[channel] += float(weight @ _periodogram(part * window))
            count[channel] += float(np.sum(weight))
        found = [math.sqrt(p / n) if n > 0 else 1.0 for p, n in zip(power, count, strict=True)]
        return found[0], found[1]

    def limit_of(self, chance: float) -> float:
        """Excess that noise alone passes with this probability, its level judged from above."""
        if self.above == 0:
            return self.noise * math.sqrt(2 / self.noise) * 4
        return self.noise * (float(fisher.isf(chance, self.noise, self.above)) - 1)


def _periodogram(part: Array) -> Array:
    """1 on average at each frequency for white noise of deviation 1."""
    spectrum = np.fft.rfft(part)
    return np.asarray((spectrum.real**2 + spectrum.imag**2) / part.size)
