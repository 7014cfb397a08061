"""The exponential of a small matrix and its derivative, compiled.

scipy's `expm` takes 0.1 ms for matrices of this size, as much as all the samples of an experiment.

Reference: C. Moler, C. Van Loan, "Nineteen dubious ways to compute the exponential of a matrix,
twenty-five years later", SIAM Review 45 (2003) 3–49, method 3.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: Taylor terms for an argument of norm 1/2 at most: 0.5¹⁶/16! is 7e-19.
TERMS = 15


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
    small, turns = matrix * scale, slopes * scale
    result, term = np.eye(size), np.eye(size)
    change, moved = np.zeros(slopes.shape), np.zeros(slopes.shape)
    for k in range(1, TERMS + 1):
        for p in range(directions):
            moved[p] = (_times(moved[p], small) + _times(term, turns[p])) / k
            change[p] += moved[p]
        term = _times(term, small) / k
        result += term
    for _ in range(halvings):
        for p in range(directions):
            change[p] = _times(change[p], result) + _times(result, change[p])
        result = _times(result, result)
    return result, change


@njit(cache=True, fastmath=False)
def _times(a, b):
    # not BLAS: its threads would decide on the last bits
    size = a.shape[0]
    product = np.zeros((size, size))
    for i in range(size):
        for k in range(size):
            factor = a[i, k]
            for j in range(size):
                product[i, j] += factor * b[k, j]
    return product
