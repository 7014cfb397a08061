"""Output error by variable projection: poles searched, all else solved linearly.

The model's free run is linear in everything but θ (the poles, see `schwarz`):

    ŷ_e(k) = c · x_e(k) + D u_e(k) + v_e · A_dᵏ b + offset

x_e is the input seen through the fixed pair (A_d, b_d) from zero, and v_e stands for the unknown
start state of experiment e, since v · A_dᵏ b runs through all free responses. So for given θ the
best c, D, v_e and offset are one linear least squares, and only θ is left to search. The measured
output is nowhere fed back, so the estimate stays consistent under coloured noise.

Reference: G. Golub, V. Pereyra, "Separable nonlinear least squares: the variable projection method
and its applications", Inverse Problems 19 (2003) R1–R26; the derivative is Kaufman's (1975).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.compiled import njit
from ldt_core.estimation.linear import schwarz
from ldt_core.estimation.linear.levenberg_marquardt import (
    corrected,
    descend,
    eliminate,
    first_damping,
    left_over,
    linear_part,
    newton,
    solved,
    tangent,
)
from ldt_core.estimation.variable_projection import least_squares_step, project_out

#: Relative gain that ends the search.
COST_TOLERANCE = 1e-9
#: Steps at most: from a subspace start 5 to 15 are usual; a search that creeps stays where it is.
MOST_STEPS = 60
#: Relative singular value of the linear part below which a direction is rounding and left at 0.
RANK_TOLERANCE = 1e-11


@dataclass(frozen=True)
class Linear:
    """What is solved for given θ: c (n,), v (experiments, n), offset."""

    c: Array
    v: Array
    offset: float


class OutputError:
    """The search for the model that runs nearest to some experiments.

    Args:
        inputs: one (L,) per experiment, scaled to about 1.
        outputs: as the inputs.
        sigma: slowest decay of the model [per sample], see `schwarz`.
        offset: whether there is an offset.
    """

    def __init__(
        self,
        inputs: list[Array],
        outputs: list[Array],
        sigma: float,
        *,
        offset: bool = True,
    ) -> None:
        self.pieces = (inputs, outputs)
        self.sigma, self.offset = sigma, offset
        self.lengths = [u.size for u in inputs]
        self.u, self.y = np.concatenate(inputs), np.concatenate(outputs)
        self.begins = np.cumsum([0, *self.lengths])
        self.count = self.u.size
        self._cut(1)

    def _cut(self, blocks: int) -> None:
        within = np.arange(blocks) / blocks
        begins = [b + np.ceil(within * n) for b, n in zip(self.begins, self.lengths, strict=False)]
        self.cuts = np.append(np.concatenate(begins), self.u.size).astype(np.int64)
        self.owners = np.repeat(np.arange(len(self.lengths)), blocks)
        self.kept = np.ones(self.owners.size, dtype=bool)

    def cut(self, blocks: int) -> Self:
        """The same search with each experiment in so many segments of (almost) equal length."""
        other = copy(self)
        other._cut(blocks)
        return other

    @property
    def longest(self) -> int:
        """Samples of the longest experiment."""
        return max(self.lengths)

    def minimise(
        self, theta: Array, steps: int = MOST_STEPS, tolerance: float = COST_TOLERANCE
    ) -> tuple[Array, float]:
        """(θ, mean square residual) of the local minimum reached from that θ."""
        low, high = schwarz.bounds(theta.size, self.sigma)
        begin = np.clip(theta, low, high)
        found, loss = descend(begin, low, high, steps, tolerance, *self.data)
        return found, loss / self.count

    def loss(self, theta: Array) -> float:
        """Mean square residual at θ (n,), all linear parameters at their best."""
        return max(float(linear_part(theta, *self.data)[2]), 0.0) / self.count  # rounding

    @property
    def data(self) -> tuple[Any, ...]:
        """What the passes of `levenberg_marquardt` take, behind θ and the bounds."""
        segments = (self.begins, self.cuts, self.kept, self.owners)
        return (self.sigma, self.u, self.y, *segments, self.offset)

    def information(self, theta: Array) -> tuple[Array, Array, Array]:
        """What the samples say of the parameters at the minimum, the start states left free.

        Returns:
            (n, n) curvature of the sum of squares over θ, all linear parameters refitted; (p, p)
            the same over c and offset at this θ; (experiments, n, p) what start states take of
            those.
        """
        linear, v, _ = linear_part(theta, *self.data)
        sigma, *data = self.data
        grams = tangent(theta, sigma, linear, v, *data)
        how = (self.kept, self.owners, len(self.lengths), theta.size)
        products, p = eliminate(grams, *how)[0], linear.size
        rest, states = solved(grams, *how)
        return rest[p:-1, p:-1], products[:p, :p], states[:, :, :p]

    def refitted(self, theta: Array, parts: Sequence[NDArray[np.bool_]]) -> list[Array]:
        """(segments,) squared residuals, summed up, of models fitted to some segments only.

        Args:
            theta: the minimum of all segments, from which each fit is one step.
            parts: (segments,) which of them are fitted, for each fit.
        """
        sigma, u, y, begins, cuts, _, owners, *flags = self.data
        fixed = (u, y, begins, cuts, self.kept, owners, *flags)
        n, low, high = theta.size, *schwarz.bounds(theta.size, self.sigma)
        linear, v, _ = linear_part(theta, *self.data)
        whole = tangent(theta, sigma, linear, v, *fixed)
        results = []
        for kept in parts:
            how = (kept, owners, len(self.lengths), n)
            grams, (rest, states) = whole, solved(whole, *how)
            change, _ = newton(rest, theta, low, high, first_damping(rest, n))
            guess = corrected(linear, v, rest, states, change)
            trial = tangent(theta + change, sigma, *guess, *fixed)
            trial_rest, trial_states = solved(trial, *how)
            if trial_rest[-1, -1] < rest[-1, -1]:
                grams, rest, states = trial, trial_rest, trial_states
            results.append(left_over(grams, owners, rest, states, linear.size))
        return results

    def solve(self, theta: Array) -> Linear:
        """The linear parameters at θ (n,)."""
        return _At(self, theta).solve()

    def solve_quickly(self, theta: Array) -> Linear:
        """The same at θ (n,) in one pass, to about 1e-8."""
        weights, v, _ = linear_part(theta, *self.data)
        return Linear(weights[: theta.size], v, float(weights[-1]) if self.offset else 0.0)

    def outputs(self, theta: Array, linear: Linear) -> Array:
        """(all samples,) the free run of every experiment, one after the other."""
        at = _At(self, theta)
        run = at.columns[:, :-1] @ at.weights(linear)
        for e, rows in self.experiments():
            run[rows] += at.free[: self.lengths[e]] @ linear.v[e]
        return run

    def without_input(self, theta: Array) -> float:
        """Mean square residual at θ (n,) when only start states and offset explain the output."""
        factor = _triangle(_At(self, theta).projected()[:, theta.size :])
        return float(factor[-1, -1] ** 2) / self.count

    def excitation(self, order: int) -> float:
        """How well the input determines a model of that order, from 0 (not at all) to 1.

        Least singular value of the input's effect on n states with poles spread over the time
        scales of the data, less what start states and offset take, relative to the whole effect.
        """
        poles = -np.geomspace(3 / self.longest, 1 / 3, order)
        at = _At(self, schwarz.from_poles(poles, self.sigma))
        factor = _triangle(np.roll(at.projected()[:, :-1], -order, axis=1))
        whole = float(np.linalg.norm(at.columns[:, :order]))
        corner = factor[-order:, -order:]
        return float(np.linalg.svd(corner, compute_uv=False)[-1]) / whole if whole else 0.0

    def experiments(self) -> Iterator[tuple[int, slice]]:
        """(index, rows of the experiment), one after the other."""
        for e in range(len(self.lengths)):
            yield e, slice(int(self.begins[e]), int(self.begins[e + 1]))


class _At:
    """The columns of the least squares at one θ, in full: slower than passes, and exact."""

    def __init__(self, search: OutputError, theta: Array) -> None:
        self.search, n = search, theta.size
        step, drive, b = schwarz.discrete(theta, search.sigma)
        states = _states(step, drive, search.u, search.begins)
        one = [np.ones(search.y.size)] if search.offset else []
        #: (all samples, n + 1 or 2): states from zero, 1, output.
        self.columns = np.column_stack([states, *one, search.y])
        self.order = n
        #: (longest, n) rows A_dᵏ b.
        self.free = _powers(step, b, search.longest)
        #: Per length: orthonormal basis of the free responses, and its triangular factor.
        self.bases = {n: np.linalg.qr(self.free[:n]) for n in set(search.lengths)}

    def projected(self) -> Array:
        """(all samples, m): the columns less what start states could explain."""
        projected = np.empty(self.columns.shape)
        for e, rows in self.search.experiments():
            basis = self.bases[self.search.lengths[e]][0]
            projected[rows] = project_out(self.columns[rows], basis)
        return projected

    def solve(self) -> Linear:
        """The linear parameters."""
        factor = _triangle(self.projected())
        weights = least_squares_step(factor[:, :-1], factor[:, -1], RANK_TOLERANCE)
        rest = self.columns[:, -1] - self.columns[:, :-1] @ weights
        n = self.order
        v = np.empty((len(self.search.lengths), n))
        for e, rows in self.search.experiments():
            basis, triangle = self.bases[self.search.lengths[e]]
            v[e] = least_squares_step(triangle, basis.T @ rest[rows], RANK_TOLERANCE)
        offset = float(weights[-1]) if self.search.offset else 0.0
        return Linear(weights[:n], v, offset)

    def weights(self, linear: Linear) -> Array:
        """The linear parameters in the order of the columns."""
        offset = [linear.offset] if self.search.offset else []
        return np.concatenate([linear.c, offset])


def _triangle(columns: Array) -> Array:
    """The triangular factor; numpy's mode "r" spends half its time on clearing the lower part."""
    packed = np.linalg.qr(columns, mode="raw")[0]
    size = packed.shape[0]
    return np.where(np.tri(size, dtype=bool).T, packed[:, :size].T, 0.0)


@njit(fastmath=False)
def _states(step, drive, u, begins):
    order = drive.size
    states = np.zeros((u.size, order))
    for e in range(begins.size - 1):
        for k in range(begins[e], begins[e + 1] - 1):
            for i in range(order):
                total = drive[i] * u[k]
                for j in range(order):
                    total += step[i, j] * states[k, j]
                states[k + 1, i] = total
    return states


@njit(fastmath=False)
def _powers(step, first, length):
    order = first.size
    rows = np.empty((length, order))
    for i in range(order):
        rows[0, i] = first[i]
    for k in range(length - 1):
        for i in range(order):
            total = 0.0
            for j in range(order):
                total += step[i, j] * rows[k, j]
            rows[k + 1, i] = total
    return rows
