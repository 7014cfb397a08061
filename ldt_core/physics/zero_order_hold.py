"""Exact discretisation of a linear system whose inputs are held between samples."""

from __future__ import annotations

import numpy as np

from ldt_core.base.arrays import Array


def zero_order_hold(a: Array, b: Array, period: float) -> tuple[Array, Array]:
    """Ad and Bd of x[k+1] = Ad x[k] + Bd u[k], by one matrix exponential of [[A, B], [0, 0]].

    Args:
        a: (n, n) [1/s].
        b: (n,) or (n, m) [unit of a state per unit of an input and s].
        period: sample period [s].
    """
    from scipy.linalg import expm  # 0.1 s to import, and not every machine needs it

    n = len(a)
    columns = np.reshape(b, (n, -1))
    block = np.zeros((n + columns.shape[1],) * 2)
    block[:n, :n], block[:n, n:] = a, columns
    moved = expm(block * period)
    return np.ascontiguousarray(moved[:n, :n]), np.ascontiguousarray(moved[:n, n:].reshape(b.shape))
