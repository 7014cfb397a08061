"""The exponential of a small matrix and its derivative, compiled.

scipy's `expm` takes 0.1 ms for matrices of this size, as much as all the samples of an experiment.

Reference: C. Moler, C. Van Loan, "Nineteen dubious ways to compute the exponential of a matrix,
twenty-five years later", SIAM Review 45 (2003) 3–49, method 3.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: Terms of the Taylor series, for an argument of norm 1/2 at most: 0.5¹⁶/16! is 7e-19.
TAYLOR_TERMS = 15


@njit(cache=True, fastmath=False)
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


@njit(cache=True, fastmath=False)
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
