"""Every sufficiently stable linear model, and no other: the Schwarz form.

    A = ⎡ −d   c₁         ⎤  − σ I      b = √(2d) e₁
        ⎢ −c₁  0   c₂     ⎥
        ⎣      −c₂  0  ⋱  ⎦

With d, c₁ … c_{n−1} > 0 the first matrix S is stable, since S + Sᵀ = −b bᵀ, and each Hurwitz
polynomial has exactly one such form (its entries are ratios of the first column of the Routh
array). A search over the logarithms θ = log(d, c₁, …, c_{n−1}) therefore reaches all models of
order n whose poles lie left of −σ, without a constraint: real, complex and repeated poles alike.
The controllability Gramian of (S, b) is the identity, which keeps the least squares for the output
well conditioned at any ratio of pole to sample rate.

σ > 0 is the slowest decay that the data can show. Without it a fit to data with unmodelled friction
invents a pole at 0 that explains the drift of one experiment and ruins the steady state.

Time is in sample periods here: A is A·T, a pole p is p·T.

References: B. D. O. Anderson, E. I. Jury, M. Mansour, "Schwarz matrix properties for continuous and
discrete time systems", Int. J. Control 23 (1976) 1–16. The exponential: C. Moler, C. Van Loan,
"Nineteen dubious ways to compute the exponential of a matrix, twenty-five years later", SIAM Review
45 (2003) 3–49, method 3; scipy's `expm` takes as long as all the samples of an experiment.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.compiled import njit

#: [per sample] Fastest decay: e^−30 within one sample cannot be told from an infinitely fast one.
FASTEST_DECAY = 30.0
#: [per longest experiment] Slowest decay: a tenth of it is seen there. A slower pole is taken for
#: an integrator, which a motor's speed does not have.
SLOWEST_PER_LENGTH = 0.1
#: Lowest d and c relative to σ: a pole this near to −σ lies on it.
LEAST_ENTRY = 1e-3
#: Size of a pole relative to σ below which it lies at the limit: a drift.
DRIFT_FACTOR = 2.0
#: Terms of the Taylor series, for an argument of norm 1/2 at most: 0.5¹⁶/16! is 7e-19.
TAYLOR_TERMS = 15


def slowest(length: int) -> float:
    """σ for experiments of up to `length` samples [per sample]."""
    return SLOWEST_PER_LENGTH / length


def bounds(order: int, sigma: float) -> tuple[Array, Array]:
    """(lowest, highest) θ."""
    return np.full(order, np.log(LEAST_ENTRY * sigma)), np.full(order, np.log(FASTEST_DECAY))


def matrices(theta: Array, sigma: float) -> tuple[Array, Array]:
    """(A, b) of θ."""
    block, _ = _generator(theta, sigma, False)
    return block[:-1, :-1].copy(), block[:-1, -1].copy()


def discrete(theta: Array, sigma: float) -> tuple[Array, Array, Array]:
    """(A_d, b_d, b): one sample of a held input, exactly."""
    block, slopes = _generator(theta, sigma, False)
    moved, _ = exponential(block, slopes)
    return moved[:-1, :-1].copy(), moved[:-1, -1].copy(), block[:-1, -1].copy()


def discrete_slopes(theta: Array, sigma: float) -> tuple[Array, Array, Array, Array, Array, Array]:
    """(A_d, b_d, b), and their derivatives by θ, (n, n, n), (n, n), (n, n), the parameter first."""
    block, slopes = _generator(theta, sigma, True)
    moved, change = exponential(block, slopes)
    return (
        *(moved[:-1, :-1].copy(), moved[:-1, -1].copy(), block[:-1, -1].copy()),
        *(change[:, :-1, :-1].copy(), change[:, :-1, -1].copy(), slopes[:, :-1, -1].copy()),
    )


@njit(fastmath=False)
def _generator(theta, sigma, with_slopes):
    """[[A, b], [0, 0]], whose exponential is the system with a held input; its derivatives by θ."""
    order = theta.size
    block = np.zeros((order + 1, order + 1))
    slopes = np.zeros((order if with_slopes else 0, order + 1, order + 1))
    for i in range(order):
        block[i, i] = -sigma
        value = np.exp(theta[i])
        if i:
            block[i - 1, i], block[i, i - 1] = value, -value
        else:
            block[0, 0] -= value
            block[0, order] = np.sqrt(2 * value)
        if with_slopes and i:
            slopes[i, i - 1, i], slopes[i, i, i - 1] = value, -value
        elif with_slopes:
            slopes[0, 0, 0], slopes[0, 0, order] = -value, block[0, order] / 2
    return block, slopes


def from_poles(poles: ArrayLike, sigma: float) -> Array:
    """θ of a model with these poles (each complex one with its conjugate), cut to the bounds.

    Poles on the wrong side are mirrored, those right of −σ are moved to it.
    """
    poles = np.atleast_1d(np.asarray(poles, dtype=np.complex128))
    low, high = bounds(poles.size, sigma)
    real = -np.clip(np.abs(poles.real) - sigma, LEAST_ENTRY * sigma, FASTEST_DECAY)
    polynomial = np.poly(real + 1j * poles.imag).real
    order = poles.size
    upper = np.zeros(order // 2 + 2)
    lower = np.zeros(order // 2 + 2)
    upper[: polynomial[0::2].size] = polynomial[0::2]
    lower[: polynomial[1::2].size] = polynomial[1::2]
    firsts = [upper[0]]
    for _ in range(order):
        firsts.append(lower[0])
        following = np.zeros_like(lower)
        following[:-1] = upper[1:] - upper[0] / lower[0] * lower[1:]
        upper, lower = lower, following
    column = np.array(firsts)
    values = np.empty(order)
    values[0] = column[1] / column[0]
    values[1:] = np.sqrt(column[2:] / column[:-2])
    return np.clip(np.log(values), low, high)


def poles_of(theta: Array, sigma: float) -> NDArray[np.complex128]:
    """(n,) poles per sample period."""
    return np.linalg.eigvals(matrices(theta, sigma)[0]).astype(np.complex128)


def drifts(theta: Array, sigma: float) -> bool:
    """Whether a pole of θ (n,) lies at the limit −σ, where decay cannot be told from drift."""
    return bool(np.abs(poles_of(theta, sigma)).min() < DRIFT_FACTOR * sigma)


@njit(fastmath=False)
def exponential(matrix, slopes):
    """exp(matrix), and its derivative in the directions slopes (p, m, m): scaling and squaring."""
    size, directions = matrix.shape[0], slopes.shape[0]
    norm = 0.0
    for i in range(size):
        row = 0.0
        for j in range(size):
            row += abs(matrix[i, j])
        norm = max(norm, row)
    halvings = 0
    while norm > 0.5:
        norm *= 0.5
        halvings += 1
    scale = 0.5**halvings
    # Matrix 0 is the exponential's, the others are those of its derivatives: arguments, last terms
    # and sums of the series, products.
    shape = (directions + 1, size, size)
    small, term, total = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    one, other = np.zeros(shape), np.zeros(shape)
    for i in range(size):
        term[0, i, i] = total[0, i, i] = 1.0
        for j in range(size):
            small[0, i, j] = matrix[i, j] * scale
            for p in range(directions):
                small[p + 1, i, j] = slopes[p, i, j] * scale
    for k in range(1, TAYLOR_TERMS + halvings + 1):
        squaring = k > TAYLOR_TERMS
        for p in range(directions + 1):
            left, right = (total, total) if squaring else (term, small)
            _times(left[p], right[0], one[p])
            if p:
                _times(left[0], right[p], other[p])
        for p in range(directions + 1):
            for i in range(size):
                for j in range(size):
                    product = one[p, i, j] + other[p, i, j] if p else one[p, i, j]
                    if squaring:
                        total[p, i, j] = product
                    else:
                        term[p, i, j] = product / k
                        total[p, i, j] += term[p, i, j]
    return total[0], total[1:]


@njit(fastmath=False)
def _times(a, b, product):
    # not BLAS: its threads would decide on the last bits
    size = a.shape[0]
    for i in range(size):
        for j in range(size):
            product[i, j] = 0.0
        for k in range(size):
            factor = a[i, k]
            for j in range(size):
                product[i, j] += factor * b[k, j]
