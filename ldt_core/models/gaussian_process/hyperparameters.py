"""Kernel parameters by marginal likelihood, on a bounded set of cells.

A machine spends most of its time in steady running, where a random subset of the data would pile
up. Cells around centres that lie as far apart as possible fill the space instead, and the mean over
a cell carries the information of all its points, with a noise variance known from the scatter
within cells. Nothing is thrown away but detail finer than a cell.

The search finds what scikit-learn's GaussianProcessRegressor finds, in a fifth of the time and
without the second of its import.

Reference: C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning" (2006),
equations 2.30 and 5.9.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.threads import one_thread
from ldt_core.models.gaussian_process.sparse import Kernel

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
#: Minus log likelihood where there is none: the search turns back.
NO_LIKELIHOOD = 1e25


def cells(x: Array, y: Array, most: int = MOST_CELLS) -> tuple[Array, Array, Array, Array]:
    """Means over cells: the neighbourhoods of centres chosen farthest first (Gonzalez, 1985).

    Args:
        x, y: inputs (n, d) and targets (n,).
        most: upper bound of the number of cells.

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
    for cell in range(max(min(most, n // POINTS_PER_CELL), 1)):
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
    size = max(float(np.sqrt(np.mean(y**2))), np.finfo(float).tiny ** 0.25)
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
