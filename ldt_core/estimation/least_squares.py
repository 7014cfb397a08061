"""Bounded nonlinear least squares, by which every fit in free run finds its parameters.

A fit gives its residuals in noise deviations; a prior is one more row, (z - mean) / deviation.
`trust_region` is the rule; `levenberg_marquardt` is for free runs that are linear over a small step
only, and `grey_box_problem` descends by the same `damped_step`, several tried side by side.
`linear.levenberg_marquardt` is apart: its residuals never exist as rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError

#: (p,) coordinates -> (N,) residuals, or (N, p) their derivatives.
Residual = Callable[[Array], Array]

# Damping of `levenberg_marquardt`, relative to each coordinate's curvature.
FIRST_DAMPING = 1e-3  # nearly a Gauss-Newton step
LEAST_DAMPING = 1e-9  # a Gauss-Newton step to rounding
MOST_DAMPING = 1e8  # a step so short that if it does not help, none will
DAMPING_FACTOR = 10.0  # to either side, after a step that helped or did not
#: Part of the largest curvature that is added to all, so that a coordinate without any is damped.
CURVATURE_FLOOR = 1e-12


FAR_STEPS = 4  # pairs of full steps behind a search that descends, as long as they help
LEAST_FAR_GAIN = 1e-6  # of the loss: a pair that gains less is the last
FAINT = 0.1  # noise deviations by which a combination of coordinates moves the rows, if it counts
TINY = 1e-300
#: Of a coordinate's last move, over which its derivative is taken. With 0.1, 0.3 and 1 the best
#: fits of the four gears of `diagnosis.effect_fit` leave 5.3, 5.0 and 4.0 % on average, at most
#: 8.3, 6.9 and 5.5 %; but with 1 one of them leaves three times as much as with the others.
PART_OF_MOVE = 0.3

#: Deviations of a number known to 5 % or so: its slopes change by half a per cent.
KEPT_MOVE = 0.1


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a search ended: (p,) coordinates, (N,) residual and (N, p) Jacobian there."""

    z: Array
    residual: Array
    jacobian: Array


def trust_region(
    residual: Residual,
    start: Array,
    low: Array | float,
    high: Array | float,
    jacobian: Residual | None = None,
    alone: Residual | None = None,
    **tolerances: Any,
) -> Solution:
    """The minimum that scipy's `least_squares` finds from a start.

    Args:
        residual: in noise deviations.
        start: (p,) within the bounds.
        low, high: (p,) or one for all, bounds.
        jacobian: of the residual; None takes difference quotients.
        alone: the residual where the Jacobian will hardly be asked for; None takes `residual`.
        tolerances: xtol, ftol, gtol and max_nfev of `scipy.optimize.least_squares`.

    Raises:
        LdtError: the search left the finite numbers.

    References:
        Branch, Coleman, Li: A subspace, interior, and conjugate gradient method for large-scale
        bound-constrained minimization problems, SIAM J. Sci. Comput. 21 (1999).
    """
    from scipy.optimize import least_squares  # 0.3 s to import

    derivative = "2-point" if jacobian is None else jacobian
    found = least_squares(residual, start, derivative, bounds=(low, high), **tolerances)
    if not np.all(np.isfinite(found.x)):
        raise LdtError("the fit left the finite numbers")
    solved = Solution(found.x, found.fun, found.jac)
    if jacobian is None:
        return solved
    for _ in range(FAR_STEPS):
        there = _through_the_bend(alone or residual, solved, low, high)
        gained = 1 - _loss(there[1]) / max(_loss(solved.residual), TINY)
        if not gained > max(tolerances.get("ftol", 0.0), LEAST_FAR_GAIN):
            break
        solved = Solution(*there, jacobian(there[0]))
    return solved


def _through_the_bend(
    residual: Residual, solved: Solution, low: Array | float, high: Array | float
) -> tuple[Array, Array]:
    """(p,) coordinates and (N,) residual two full Gauss-Newton steps on, by one Jacobian.

    In a narrow valley that bends, a full step leaves the valley's floor, and a search that must
    descend takes short ones. The second step leads back to the floor, far from where both began:
    what counts is where they end (Chamberlain, Powell, Lemarechal, Pedersen: The watchdog technique
    for forcing convergence in algorithms for constrained optimization, 1982).
    """
    z, rows = solved.z, solved.residual
    u, size, v = np.linalg.svd(solved.jacobian, full_matrices=False)
    counts = size > FAINT
    inverse = (v[counts].T / size[counts]) @ u[:, counts].T
    for _ in range(2):
        if not np.all(np.isfinite(rows)):
            break
        z = np.clip(z - inverse @ rows, low, high)
        rows = residual(z)
    return z, np.nan_to_num(rows, nan=np.inf, posinf=np.inf)


def _loss(rows: Array) -> float:
    return float(rows @ rows)


def levenberg_marquardt(
    residual: Residual,
    jacobian: Residual,
    start: Array,
    low: Array,
    high: Array,
    longest: Array,
    steps: int,
    least_change: float,
) -> Array:
    """(p,) the minimum reached by damped Gauss-Newton steps of limited length.

    scipy's `least_squares` can neither limit each component of a step nor stop where a step changes
    the samples by less than the noise.

    Args:
        residual, jacobian: in noise deviations.
        start: (p,).
        low, high: (p,) bounds.
        longest: (p,) change of each coordinate by one step, at most.
        steps: accepted steps at most.
        least_change: of all samples together, in deviations of the present residual. A step that
            changes them less is the last.

    References:
        Marquardt: An algorithm for least-squares estimation of nonlinear parameters, SIAM J. Appl.
        Math. 11 (1963).
    """
    z = np.clip(start, low, high)
    rows, damping = residual(z), FIRST_DAMPING
    for _ in range(steps):
        slopes = jacobian(z)
        normal, slope = slopes.T @ slopes, slopes.T @ rows
        loss = float(rows @ rows)
        moved, better = z, rows
        while damping < MOST_DAMPING:
            moved = np.clip(z + damped_step(normal, slope, damping, longest), low, high)
            better = residual(moved)
            if float(better @ better) < loss:
                break
            damping *= DAMPING_FACTOR
        else:
            break
        change = slopes @ (moved - z)
        damping = max(damping / DAMPING_FACTOR, LEAST_DAMPING)
        z, rows = moved, better
        if float(change @ change) < least_change**2 * loss / max(rows.size, 1):
            break
    return z


def damped_step(normal: Array, slope: Array, damping: float, longest: Array) -> Array:
    """(p,) Marquardt's step for JᵀJ (p, p) and Jᵀr (p,), no coordinate longer than (p,)."""
    diagonal = np.diag(normal)
    floor = CURVATURE_FLOOR * max(float(diagonal.max()), 1e-300)
    step = np.linalg.solve(normal + np.diag(damping * diagonal + floor), -slope)
    return np.asarray(step / max(1.0, float(np.max(np.abs(step) / longest))))


class ForwardDifferences:
    """A residual with its derivative by difference quotients, backward where a bound is near.

    A search asks for the derivative where it was last, unless that step did not help: so the
    derivative is computed along with the residual where that takes no longer than it does alone.

    Args:
        residuals: points (p,) -> of each (N,): all at once, for what computes several together.
        step: (p,) of the coordinates, or one for all.
        high: (p,) upper bounds.
        longest: (p,) steps to begin with, or one for all; None for `step`. Where laws have corners,
            a short quotient tells of the corner, and a long one of what is behind. Later ones are a
            part of the last move.
        steady: (p,) coordinates, in deviations of what is known of them, whose derivative hardly
            changes: it is found anew once one of them has moved by `KEPT_MOVE`. None for none.
        abreast: points that are computed in the time of one.
    """

    def __init__(
        self,
        residuals: Callable[[list[Array]], list[Array]],
        step: Array | float,
        high: Array,
        steady: NDArray[np.bool_] | None = None,
        abreast: float = 1.0,
        longest: Array | float | None = None,
    ) -> None:
        self._residuals, self._high, self._abreast = residuals, high, abreast
        self._steady = np.zeros(high.size, bool) if steady is None else steady
        self._found: Array | None = None
        self._found_at = np.zeros(0)
        self._step = np.broadcast_to(np.asarray(step, dtype=np.float64), high.shape)
        most = self._step if longest is None else longest
        self._longest = np.maximum(np.broadcast_to(most, high.shape), self._step)
        self._asked_at: Array | None = None
        #: Points where residuals were found last, the first of them where it was asked for.
        self._last: list[tuple[Array, Array]] = []

    def residual(self, z: Array) -> Array:
        """(N,) at z (p,)."""
        moved = self._moved(z, self._anew(z))
        both, alone = (math.ceil(k / self._abreast) for k in (len(moved) + 1, len(moved)))
        return self._find([z, *moved] if both == alone else [z])

    def residual_alone(self, z: Array) -> Array:
        """The same, where the derivative will hardly be asked for."""
        return self._find([z])

    def _find(self, points: list[Array]) -> Array:
        self._last = [(z.copy(), r) for z, r in zip(points, self._residuals(points), strict=True)]
        return self._last[0][1]

    def _anew(self, z: Array) -> list[int]:
        """Coordinates whose derivative is to be found anew at z (p,)."""
        kept = self._found is not None
        if kept and (np.abs(z - self._found_at)[self._steady] > KEPT_MOVE).any():
            kept = False
        return [j for j in range(z.size) if not (kept and self._steady[j])]

    def _moved(self, z: Array, coordinates: Sequence[int]) -> list[Array]:
        found = [z.copy() for _ in coordinates]
        steps = self._longest
        if self._asked_at is not None:
            moved = PART_OF_MOVE * np.abs(z - self._asked_at)
            steps = np.clip(moved, self._step, self._longest)
        for j, there in zip(coordinates, found, strict=True):
            step = float(steps[j])
            there[j] += step if z[j] + step <= self._high[j] else -step
        return found

    def jacobian(self, z: Array) -> Array:
        """(N, p) at z (p,)."""
        anew = self._anew(z)
        if len(anew) == z.size:
            self._found_at = z.copy()
        points = [z, *self._moved(z, anew)]
        known = {there.tobytes(): rows for there, rows in self._last}
        asked = [there for there in points if there.tobytes() not in known]
        known |= {a.tobytes(): r for a, r in zip(asked, self._residuals(asked), strict=True)}
        base, *found = (known[there.tobytes()] for there in points)
        columns = np.empty((base.size, z.size)) if self._found is None else self._found.copy()
        for j, there, rows in zip(anew, points[1:], found, strict=True):
            columns[:, j] = (rows - base) / (there[j] - z[j])
        self._found, self._asked_at = columns, z.copy()
        return columns
