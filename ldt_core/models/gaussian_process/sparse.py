"""Sparse Gaussian-process regression on linear observations of the function.

With inducing inputs z the function is f(x) = k(x, z) L⁻ᵀ β, β ~ N(0, I), L Lᵀ = k(z, z): the
deterministic training conditional, DTC (Quiñonero-Candela and Rasmussen, "A unifying view of sparse
approximate Gaussian process regression", JMLR 2005). The data need not be values of f. Any row that
is a linear functional of f plus white noise of variance noise_std² will do, such as the innovation
of an observer that f drives (see `observer`): the same functional is taken of the columns k(·, z).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular

from ldt_core.base.arrays import Array

#: Share of the prior variance that is left, at most, when no more inducing points are added. It
#: bounds the condition of k(z, z) by its inverse times the number of points.
RESIDUAL_SHARE = 1e-6
#: Inducing points that carry the deviation: the first ones chosen, hence spread widest. The
#: covariance between them grows with the square of their number, in time and in the record.
DEVIATION_POINTS = 128


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


@dataclass(frozen=True, eq=False)
class SparsePosterior:
    """A trained function: mean k(x, z) weights, variance k(x, x) - k(x, z₁) explained k(z₁, x).

    Args:
        kernel: the prior.
        inducing: z (m, d).
        weights: (m,).
        explained: (p, p) symmetric; z₁ are the first p of the inducing inputs.
    """

    kernel: Kernel
    inducing: Array
    weights: Array
    explained: Array

    def mean(self, x: Array) -> Array:
        """(n,) posterior mean at inputs (n, d)."""
        return self.kernel(x, self.inducing) @ self.weights

    def std(self, x: Array) -> Array:
        """(n,) posterior standard deviation at inputs (n, d), that of the prior far from data."""
        row = self.kernel(x, self.inducing[: len(self.explained)])
        known = np.einsum("ij,ij->i", row @ self.explained, row)
        return np.sqrt(np.maximum(self.kernel.signal_std**2 - known, 0.0))


def choose_inducing(x: Array, kernel: Kernel, most: int) -> Array:
    """(m, d) inducing inputs among x (n, d), each where the prior given those before varies most.

    Pivoted Cholesky (Burt, Rasmussen, van der Wilk, "Convergence of sparse variational inference in
    Gaussian processes regression", JMLR 2020). Ends early once nothing is left to explain, so that
    m <= `most` fits the length scale.
    """
    left = np.full(len(x), kernel.signal_std**2)
    rows = np.empty((min(most, len(x)), len(x)))
    chosen: list[int] = []
    while len(chosen) < len(rows):
        at = int(np.argmax(left))
        if left[at] <= RESIDUAL_SHARE * kernel.signal_std**2:
            break
        done = rows[: len(chosen)]
        row = kernel(x[at : at + 1], x)[0] - done[:, at] @ done
        rows[len(chosen)] = row / np.sqrt(left[at])
        left -= rows[len(chosen)] ** 2
        left[at] = 0.0
        chosen.append(at)
    return x[chosen]


def condition(
    kernel: Kernel,
    inducing: Array,
    observations: Iterable[tuple[Array, Array]],
    noise_std: float,
) -> SparsePosterior:
    """The posterior given observations y = functional of f + white noise.

    Args:
        kernel: the prior.
        inducing: z (m, d), as `choose_inducing` orders them.
        observations: pairs of rows (n, m), the functional of each column k(·, z), and y (n,).
        noise_std: standard deviation of the noise, above 0.

    Raises:
        numpy.linalg.LinAlgError: numbers that overflow.
    """
    together = ((rows, y, np.zeros(len(y), dtype=np.int64)) for rows, y in observations)
    return condition_in_parts(kernel, inducing, together, noise_std, 1)[0]


def condition_in_parts(
    kernel: Kernel,
    inducing: Array,
    observations: Iterable[tuple[Array, Array, NDArray[np.int64]]],
    noise_std: float,
    parts: int,
) -> list[SparsePosterior]:
    """The posterior given all observations, then those without each part of them.

    As `condition`, each observation with the part (n,) that each of its rows belongs to, from 0;
    with one part nothing is left out.
    """
    points = len(inducing)
    prior = kernel(inducing, inducing)
    # The residual share bounds the eigenvalues from below; this only covers their rounding errors.
    prior[np.diag_indices(points)] *= 1.0 + 1e-10
    lower = cholesky(prior, lower=True)
    gram, right = np.zeros((parts, points, points)), np.zeros((parts, points))
    for rows, y, part in observations:
        white = solve_triangular(lower, rows.T, lower=True) / noise_std
        for p in range(parts):
            own = white if parts == 1 else white[:, part == p]
            gram[p] += own @ own.T
            right[p] += own @ ((y if parts == 1 else y[part == p]) / noise_std)
    whole = (gram.sum(axis=0), right.sum(axis=0))
    sums = [whole]
    if parts > 1:
        sums += [(whole[0] - gram[p], whole[1] - right[p]) for p in range(parts)]
    return [_posterior(kernel, inducing, lower, g + np.eye(points), r) for g, r in sums]


def _posterior(
    kernel: Kernel, inducing: Array, lower: Array, gram: Array, right: Array
) -> SparsePosterior:
    factor = cholesky(gram, lower=True)
    weights = solve_triangular(lower, cho_solve((factor, True), right), lower=True, trans="T")
    # Both factors of a leading block are the leading blocks of the factors, so the posterior that
    # has only the first points comes without another pass through the data.
    p = min(len(inducing), DEVIATION_POINTS)
    inverse = solve_triangular(lower[:p, :p], np.eye(p), lower=True)
    shrunk = solve_triangular(factor[:p, :p], inverse, lower=True)
    explained = inverse.T @ inverse - shrunk.T @ shrunk
    return SparsePosterior(kernel, inducing, weights, (explained + explained.T) / 2)
