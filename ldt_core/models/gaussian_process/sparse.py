"""Sparse Gaussian-process regression on linear observations, and the kernel's parameters for it.

With inducing inputs z the function is f(x) = k(x, z) L⁻ᵀ β, β ~ N(0, I), L Lᵀ = k(z, z): the
deterministic training conditional, DTC (Quiñonero-Candela and Rasmussen, "A unifying view of sparse
approximate Gaussian process regression", JMLR 2005). The data need not be values of f. Any row that
is a linear functional of f plus white noise of variance noise_std² will do, such as the innovation
of an observer that f drives (see `observer`): the same functional is taken of the columns k(·, z).

Kernel parameters are those of greatest marginal likelihood on a bounded set of cells. A machine
spends most of its time in steady running, where a random subset of the data would pile up. Cells
around centres that lie as far apart as possible fill the space instead, and the mean over a cell
carries the information of all its points, with a noise variance known from the scatter within
cells. Nothing is thrown away but detail finer than a cell. The search finds what scikit-learn's
GaussianProcessRegressor finds, in a fifth of the time and without the second of its import.

Reference: C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning" (2006),
equations 2.30 and 5.9.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import rms
from ldt_core.base.threads import one_thread

#: Share of the prior variance that is left, at most, when no more inducing points are added. It
#: bounds the condition of k(z, z) by its inverse times the number of points.
RESIDUAL_SHARE = 1e-6
#: Inducing points that carry the deviation: the first ones chosen, hence spread widest. The
#: covariance between them grows with the square of their number, in time and in the record.
DEVIATION_POINTS = 128
#: Cells at most: 256³ operations a step take about 0.1 s for the whole search.
MOST_CELLS = 256
#: Points in a cell, on average at least: the scatter within cells has to be an estimate.
POINTS_PER_CELL = 4
#: Random starts besides the first: without any the search was seen to get stuck.
RESTARTS = 2
#: [spans of the input] Longest length scale: a straight line. The shortest is two cells, since
#: finer detail is averaged away.
LONGEST_LENGTH = 3.0
#: Bounds of the prior deviation relative to the root mean square of the targets: the function may
#: hide in the noise, or lie mostly outside of the data.
SIGNAL_RANGE = (1e-2, 1e1)
#: Noise variance relative to that of the targets, at least: also the jitter of exact data.
LEAST_NOISE_SHARE = 1e-8
#: Inputs of which covariances are computed at a time: 100 MB with 200 inducing points, however
#: long an experiment is.
ROWS = 2**15
#: Minus log likelihood where there is none: the search turns back.
NO_LIKELIHOOD = 1e25


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
        rows = range(0, max(len(x), 1), ROWS)
        parts = [self.kernel(x[at : at + ROWS], self.inducing) @ self.weights for at in rows]
        return np.concatenate(parts) if len(parts) > 1 else parts[0]

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
    from scipy.linalg import cholesky, solve_triangular  # 0.2 s; who only predicts needs none

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
    from scipy.linalg import cho_solve, cholesky, solve_triangular

    factor = cholesky(gram, lower=True)
    weights = solve_triangular(lower, cho_solve((factor, True), right), lower=True, trans="T")
    # Both factors of a leading block are the leading blocks of the factors, so the posterior that
    # has only the first points comes without another pass through the data.
    p = min(len(inducing), DEVIATION_POINTS)
    inverse = solve_triangular(lower[:p, :p], np.eye(p), lower=True)
    shrunk = solve_triangular(factor[:p, :p], inverse, lower=True)
    explained = inverse.T @ inverse - shrunk.T @ shrunk
    return SparsePosterior(kernel, inducing, weights, (explained + explained.T) / 2)


def cells(x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
    """Means over cells: the neighbourhoods of centres chosen farthest first (Gonzalez, 1985).

    Args:
        x, y: inputs (n, d) and targets (n,).

    Returns:
        inputs (c, d), targets (c,), noise variance of each target (c,), mean width of a cell (d,).

    Raises:
        LdtError: inputs that do not vary, or numbers that overflow.
    """
    n, d = x.shape
    # The root is taken since squares of all these numbers have to be finite as well.
    largest = np.sqrt(np.finfo(float).max) / n
    if not (np.abs(x) < largest).all() or not (np.abs(y) < largest).all():
        raise LdtError("Gaussian process: the training data are not finite numbers of a sane size")
    span = np.ptp(x, axis=0)
    if not (span > 0).all():
        raise LdtError(
            f"Gaussian process: input {int(np.argmin(span)) + 1} of {d} is the same in all the "
            "training data, so nothing can be learned over it"
        )
    scaled = x / span
    nearest, member = np.full(n, np.inf), np.zeros(n, dtype=np.int64)
    centre = int(np.argmin(x[:, 0]))
    for cell in range(max(min(MOST_CELLS, n // POINTS_PER_CELL), 1)):
        distance = np.sum((scaled - scaled[centre]) ** 2, axis=1)
        closer = distance < nearest
        nearest[closer], member[closer] = distance[closer], cell
        centre = int(np.argmax(nearest))
        if nearest[centre] == 0:
            break
    _, member, count = np.unique(member, return_inverse=True, return_counts=True)
    columns = np.column_stack([x, y])
    sums = np.column_stack([np.bincount(member, weights=column) for column in columns.T])
    means: Array = sums / count[:, None]
    scatter = np.sum((columns - means[member]) ** 2, axis=0) / max(n - len(count), 1)
    width = np.sqrt(12 * scatter[:d])  # of a uniform distribution with that variance
    return means[:, :d].copy(), means[:, d].copy(), scatter[d] / count, width


def fit_hyperparameters(x: Array, y: Array, shortest: Array | float = 0.0) -> Kernel:
    """The squared-exponential kernel of greatest marginal likelihood, one length scale per input.

    Args:
        x, y: inputs (n, d) and targets (n,), zero-mean deviations from the prior mean 0.
        shortest: lower bound of the length scales, each (d,) or all; two cells at least.

    Raises:
        LdtError: inputs that do not vary, or numbers that overflow.
    """
    from scipy.optimize import minimize  # 0.4 s to import, and a twin that only predicts needs none

    inputs, targets, variance, width = cells(x, y)
    size = max(rms(y), np.finfo(float).tiny ** 0.25)
    span = np.ptp(x, axis=0)
    low = np.maximum(2 * width, shortest) / span
    high = np.maximum(LONGEST_LENGTH, 2 * low)
    # In units of the spans and of the targets' size: the search is then the same in any unit.
    scaled = inputs / span
    squares = np.array([np.subtract.outer(column, column) ** 2 for column in scaled.T])
    noise = np.maximum(variance / size**2, LEAST_NOISE_SHARE)
    bounds = np.log([[s**2 for s in SIGNAL_RANGE], *np.column_stack([low, high])])
    start = np.log([0.5, *np.clip(np.sqrt(low * 0.5), low, high)])
    random = np.random.RandomState(0)
    starts = [start, *(random.uniform(*bounds.T) for _ in range(RESTARTS))]
    with one_thread():  # more would be slower on small matrices, and decide on the last bits
        found = [
            minimize(
                minus_log_likelihood,
                begin,
                args=(squares, targets / size, noise),
                jac=True,
                method="L-BFGS-B",
                bounds=bounds,
            )
            for begin in starts
        ]
    variance, *lengths = np.exp(min(found, key=lambda result: result.fun).x)
    return Kernel(size * float(np.sqrt(variance)), tuple(np.array(lengths) * span))


def minus_log_likelihood(
    theta: Array, squares: Array, targets: Array, noise: Array
) -> tuple[float, Array]:
    """The negative log marginal likelihood, without its constant, and its derivative (1 + d,).

    `theta` holds the logarithms of the prior variance and of the d length scales, `squares` the
    squared differences of the inputs (d, n, n), `noise` the variance of each target (n,).
    """
    from scipy.linalg.lapack import dpotrf, dpotri, dpotrs

    weights = np.exp(-2 * theta[1:])
    covariance = np.exp(theta[0] - 0.5 * np.tensordot(weights, squares, 1))
    noisy = covariance.copy()
    noisy[np.diag_indices(len(targets))] += noise
    factor, failed = dpotrf(noisy, lower=1, clean=0, overwrite_a=1)
    if failed:  # not positive by rounding
        return NO_LIKELIHOOD, np.zeros(len(theta))
    solved, _ = dpotrs(factor, targets, lower=1)
    value = 0.5 * float(targets @ solved) + float(np.log(factor.diagonal()).sum())
    inverse, _ = dpotri(factor, lower=1, overwrite_c=1)
    # Both are symmetric: the lower triangle of the inverse counts twice, its diagonal once.
    inverse = np.tril(inverse)
    twice = 2 * inverse
    twice[np.diag_indices(len(targets))] = inverse.diagonal()
    change = (np.outer(solved, solved) - twice) * covariance
    slopes = [change.sum(), *(weights * np.tensordot(squares, change, 2))]
    return value, -0.5 * np.array(slopes)
