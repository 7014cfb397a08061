"""The squared-exponential kernel, as MATLAB's `fitrgp` and scikit-learn's `RBF` have it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Kernel:
    """k(x, z) = signal_std² exp(-½ Σ_d ((x_d - z_d) / length_scales_d)²).

    Args:
        signal_std: prior standard deviation of the function, above 0.
        length_scales: one for each input, above 0, in that input's unit.

    Raises:
        ValueError: numbers that are not above 0, or no input at all.
    """

    signal_std: float
    length_scales: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "signal_std", float(self.signal_std))
        object.__setattr__(self, "length_scales", tuple(float(v) for v in self.length_scales))
        numbers = (self.signal_std, *self.length_scales)
        if len(numbers) < 2 or not all(math.isfinite(v) and v > 0 for v in numbers):
            raise ValueError(f"kernel: expected finite numbers above 0, got {numbers}")

    def __call__(self, x: Array, z: Array) -> Array:
        """(n, m) covariances between inputs x (n, d) and z (m, d)."""
        # Differences per input, not |x|² + |z|² - 2 x·z: that cancels for near neighbours.
        exponent = np.zeros((len(x), len(z)))
        for d, length in enumerate(self.length_scales):
            step = x[:, d, None] / length - z[None, :, d] / length
            np.multiply(step, step, out=step)
            exponent += step
        exponent *= -0.5
        np.exp(exponent, out=exponent)
        exponent *= self.signal_std**2
        return exponent
