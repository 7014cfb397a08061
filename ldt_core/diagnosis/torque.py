"""The torque on the shaft that would explain a residual.

The residual speed of a motor under an extra torque T follows J r' = T - (J / tau) r, tau being the
time in which the motor forgets its speed. Turned round, with the residual smoothed, it gives the
torque at each moment, where the free run's error itself would smear it over tau.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

Array = NDArray[np.float64]

WINDOW = 0.7  # of the motor's memory: over which the residual is smoothed
DEGREE = 2


class Torque:
    """Smoothing and turning round, for one sample period.

    Args:
        inertia: J [kg m^2].
        memory: tau [s].
        period: of the samples [s].
        length: of the experiment, in samples.
    """

    def __init__(self, inertia: float, memory: float, period: float, length: int) -> None:
        samples = max(int(WINDOW * memory / period) | 1, DEGREE + 3)
        self.window = min(samples, length - 1 + length % 2)
        self.inertia, self.memory, self.period = inertia, memory, period

    def smooth(self, signal: Array, derivative: int = 0) -> Array:
        """(L,) signal or its derivative."""
        if self.window <= DEGREE:
            return np.gradient(signal, self.period) if derivative else signal
        return np.asarray(
            savgol_filter(signal, self.window, DEGREE, deriv=derivative, delta=self.period)
        )

    def of(self, residual: Array) -> Array:
        """(L,) torque [N m] that explains (L,) measured minus simulated speed [rad/s]."""
        return self.inertia * (self.smooth(residual, 1) + self.smooth(residual) / self.memory)

    @property
    def noise(self) -> float:
        """Deviation of the torque [N m] per deviation of white noise on the speed [rad/s]."""
        if self.window <= DEGREE:
            return self.inertia / self.memory
        slope = savgol_coeffs(self.window, DEGREE, deriv=1, delta=self.period)
        mean = savgol_coeffs(self.window, DEGREE)
        return float(self.inertia * np.linalg.norm(slope + mean / self.memory))
