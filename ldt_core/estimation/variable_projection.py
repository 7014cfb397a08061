"""Unknown start states, taken out of a least squares: variable projection.

What an experiment's speed and current were at its first sample is known only through noise. To
first order they move its residuals in a few directions, whatever the parameters are. Residuals and
derivatives less their part along these directions are those of the least squares in which the start
states are at their best. For a linear machine that is exact, else linear about the latest estimate.

Reference: G. Golub, V. Pereyra, "Separable nonlinear least squares: the variable projection method
and its applications", Inverse Problems 19 (2003) R1-R26.
"""

from __future__ import annotations

import numpy as np

from ldt_core.base.arrays import Array

#: Singular value of columns of length 1, at least: below, a direction is already in the others.
LEAST_SINGULAR = 1e-6


def basis_of(columns: Array) -> Array:
    """(N, k) orthonormal directions that span columns (N, s); what shows nothing is left out."""
    if columns.shape[1] == 0:
        return columns
    left, size, _ = np.linalg.svd(
        columns / (np.linalg.norm(columns, axis=0) + 1e-300), full_matrices=False
    )
    return np.asarray(left[:, size > LEAST_SINGULAR])


def project_out(rows: Array, basis: Array) -> Array:
    """Rows (N,) or (N, p) less their part along the directions of a basis (N, k)."""
    return np.asarray(rows - basis @ (basis.T @ rows))


def least_squares_step(columns: Array, target: Array, rcond: float | None = None) -> Array:
    """(s,) combination of the columns (N, s) that is nearest to a target (N,).

    Args:
        columns: in any units; they are scaled to length 1.
        target: to be explained.
        rcond: singular value, relative to the largest, below which a direction counts as none.
    """
    size = np.linalg.norm(columns, axis=0)
    size[size == 0] = 1.0
    return np.asarray(np.linalg.lstsq(columns / size, target, rcond=rcond)[0] / size)
