"""Output error by variable projection: poles searched, all else solved linearly.

The model's free run is linear in everything but θ (the poles, see `schwarz`):

    ŷ_e(k) = c · x_e(k) + D u_e(k) + v_e · A_dᵏ b + offset

x_e is the input seen through the fixed pair (A_d, b_d) from zero, and v_e stands for the unknown
start state of experiment e, since v · A_dᵏ b runs through all free responses. So for given θ the
best c, D, v_e and offset are one linear least squares, and only θ (n numbers, whatever the number
of experiments) is left to `scipy.optimize.least_squares`. The measured output is nowhere fed back:
what is minimised is the error of the free run, which stays consistent under coloured noise.

Reference: G. Golub, V. Pereyra, "Separable nonlinear least squares: the variable projection method
and its applications", Inverse Problems 19 (2003) R1–R26; the derivative is Kaufman's (1975).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ldt_core.identification import schwarz

Array = NDArray[np.float64]

#: Relative change of cost and of θ that ends the search: 1e-9 in θ is 1e-9 of a pole.
COST_TOLERANCE = 1e-9
THETA_TOLERANCE = 1e-9
#: The residual is scaled by the deviation of the output, so that this means "exact".
GRADIENT_TOLERANCE = 1e-14
#: From a subspace start 5 to 15 steps are usual; a search that creeps stays where it is.
MOST_STEPS = 60
#: Directions of the linear part weaker than this, relative, are rounding and left at 0.
RANK_TOLERANCE = 1e-11


@dataclass(frozen=True)
class Linear:
    """What is solved for given θ: c (n,), D, v (experiments, n), offset."""

    c: Array
    D: float
    v: Array
    offset: float


class OutputError:
    """The search for the model that runs nearest to some experiments.

    Args:
        inputs: one (L,) per experiment, scaled to about 1.
        outputs: as the inputs.
        sigma: slowest decay of the model [per sample], see `schwarz`.
        feedthrough: whether there is a D.
        used: per length L an (L,) mask of the samples to fit; None takes all.
    """

    def __init__(
        self,
        inputs: list[Array],
        outputs: list[Array],
        sigma: float,
        feedthrough: bool = False,
        used: dict[int, NDArray[np.bool_]] | None = None,
    ) -> None:
        self.lengths = [u.size for u in inputs]
        self.u = np.concatenate(inputs)
        self.y = np.concatenate(outputs)
        self.begins = np.cumsum([0, *self.lengths])
        self.sigma = sigma
        self.feedthrough = feedthrough
        self.used = used
        self.count = sum(int(used[n].sum()) if used else n for n in self.lengths)

    def pieces(self) -> tuple[list[Array], list[Array]]:
        """Inputs and outputs, one of each per experiment."""
        cuts = self.begins[1:-1]
        return np.split(self.u, cuts), np.split(self.y, cuts)

    def refit(self, used: dict[int, NDArray[np.bool_]]) -> OutputError:
        """The same search on some of the samples."""
        return OutputError(*self.pieces(), self.sigma, self.feedthrough, used)

    @property
    def longest(self) -> int:
        """Samples of the longest experiment."""
        return max(self.lengths)

    def minimise(self, theta: Array, steps: int = MOST_STEPS) -> tuple[Array, float]:
        """(θ, mean square residual) of the local minimum reached from that θ."""
        low, high = schwarz.bounds(theta.size, self.sigma)
        inside = 1e-6 * (high - low)  # the search must begin off the bounds
        last: dict[bytes, tuple[Array, Array]] = {}

        def at(point: Array) -> tuple[Array, Array]:
            key = point.tobytes()  # residual and derivative are asked for apart, and come together
            if key not in last:
                last.clear()
                last[key] = self._residual(point)
            return last[key]

        result = least_squares(
            lambda point: at(point)[0],
            np.clip(theta, low + inside, high - inside),
            jac=lambda point: at(point)[1],
            bounds=(low, high),
            ftol=COST_TOLERANCE,
            xtol=THETA_TOLERANCE,
            gtol=GRADIENT_TOLERANCE,
            max_nfev=steps,
        )
        return result.x, 2 * float(result.cost)

    def loss(self, theta: Array) -> float:
        """Mean square residual at θ, all linear parameters at their best."""
        factor = _triangle(_At(self, theta).projected())
        return float(factor[-1, -1] ** 2) / self.count

    def solve(self, theta: Array) -> Linear:
        """The linear parameters at θ."""
        return _At(self, theta).solve()

    def outputs(self, theta: Array, linear: Linear) -> Array:
        """(all samples,) the free run of every experiment, one after the other."""
        at = _At(self, theta)
        D = [linear.D] if self.feedthrough else []
        run = at.columns[:, :-1] @ np.concatenate([linear.c, D, [linear.offset]])
        for e, rows, _ in self.experiments():
            run[rows] += at.free[: self.lengths[e]] @ linear.v[e]
        return run

    def without_input(self, theta: Array) -> float:
        """Mean square residual when only start states and offset explain the output."""
        factor = _triangle(_At(self, theta).projected()[:, -2:])
        return float(factor[-1, -1] ** 2) / self.count

    def excitation(self, order: int) -> float:
        """How well the input determines a model of that order, from 0 (not at all) to 1.

        Least singular value of the input's effect on n states with poles spread over the time
        scales of the data, less what start states, offset and feedthrough take, relative to that
        effect as a whole.
        """
        poles = -np.geomspace(3 / self.longest, 1 / 3, order)
        at = _At(self, schwarz.from_poles(poles, self.sigma))
        factor = _triangle(np.roll(at.projected()[:, :-1], -order, axis=1))
        whole = float(np.linalg.norm(at.states))
        corner = factor[-order:, -order:]
        return float(np.linalg.svd(corner, compute_uv=False)[-1]) / whole if whole else 0.0

    def _residual(self, theta: Array) -> tuple[Array, Array]:
        """Residual and its derivative by θ, turned into n + 1 rows.

        One orthogonal factor changes neither the cost nor a step of the search, and leaves it a
        matrix of n + 1 rows instead of one row for each sample.
        """
        at = _At(self, theta)
        before = at.projected()
        change = at.change(at.solve(before))
        stacked = np.column_stack([before[:, :-1], at.project(change), before[:, -1]])
        factor = _triangle(stacked)
        m = before.shape[1] - 1
        corner = factor[m:, m:] / np.sqrt(self.count)
        return corner[:, -1].copy(), -corner[:, :-1]

    def experiments(self) -> Iterator[tuple[int, slice, NDArray[np.bool_] | slice]]:
        """(index, rows of the experiment, which of them are fitted), one after the other."""
        for e, length in enumerate(self.lengths):
            rows = slice(int(self.begins[e]), int(self.begins[e + 1]))
            yield e, rows, self.used[length] if self.used else slice(None)


class _At:
    """Everything that a given θ makes of the data, each computed once."""

    def __init__(self, search: OutputError, theta: Array) -> None:
        self.search, self.theta = search, theta
        self.step, drive, b = schwarz.discrete(theta, search.sigma)
        n = theta.size
        #: (all samples, n + 2 or 3): states from zero, input if it feeds through, 1, output.
        self.columns = np.empty((search.y.size, n + 2 + search.feedthrough))
        self.states = _states(self.step, drive, search.u, search.begins)
        self.columns[:, :n] = self.states
        if search.feedthrough:
            self.columns[:, n] = search.u
        self.columns[:, -2] = 1.0
        self.columns[:, -1] = search.y
        #: (longest, n) rows A_dᵏ b.
        self.free = _powers(self.step, b, search.longest)
        #: Per length: orthonormal basis of the free responses, and its triangular factor.
        self.bases = {
            length: np.linalg.qr(self.free[:length][search.used[length]])
            if search.used
            else np.linalg.qr(self.free[:length])
            for length in set(search.lengths)
        }

    def project(self, columns: Array) -> Array:
        """(fitted samples, m): the columns less what start states could explain."""
        projected = np.empty((self.search.count, columns.shape[1]))
        at = 0
        for e, rows, kept in self.search.experiments():
            basis, part = self.bases[self.search.lengths[e]][0], columns[rows][kept]
            projected[at : at + len(part)] = part - basis @ (basis.T @ part)
            at += len(part)
        return projected

    def projected(self) -> Array:
        """The regressors and, last, the output, projected."""
        return self.project(self.columns)

    def solve(self, projected: Array | None = None) -> Linear:
        """The linear parameters."""
        factor = _triangle(self.projected() if projected is None else projected)
        weights = _least_squares(factor[:, :-1], factor[:, -1])
        rest = self.columns[:, -1] - self.columns[:, :-1] @ weights
        n = self.theta.size
        v = np.empty((len(self.search.lengths), n))
        for e, rows, kept in self.search.experiments():
            basis, triangle = self.bases[self.search.lengths[e]]
            v[e] = _least_squares(triangle, basis.T @ rest[rows][kept])
        D = float(weights[n]) if self.search.feedthrough else 0.0
        return Linear(weights[:n], D, v, float(weights[-1]))

    def change(self, linear: Linear) -> Array:
        """(all samples, n): derivative of the free run by θ, linear parameters held."""
        search = self.search
        step, drive, b = schwarz.discrete_slopes(self.theta, search.sigma)
        change = _sensitivity(
            self.step, step, drive, self.states, search.u, linear.c, search.begins
        )
        free = _free_slopes(self.step, step, b, self.free)
        for e, rows, _ in search.experiments():
            change[rows] += free[: search.lengths[e]] @ linear.v[e]
        return change


def _triangle(columns: Array) -> Array:
    """The triangular factor; numpy's mode "r" spends half its time on clearing the lower part."""
    packed = np.linalg.qr(columns, mode="raw")[0]
    size = packed.shape[0]
    return np.where(np.tri(size, dtype=bool).T, packed[:, :size].T, 0.0)


def _least_squares(columns: Array, target: Array) -> Array:
    size = np.sqrt((columns**2).sum(axis=0))
    size[size == 0] = 1.0
    return np.linalg.lstsq(columns / size, target, rcond=RANK_TOLERANCE)[0] / size


@njit(cache=True, fastmath=False)
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


@njit(cache=True, fastmath=False)
def _sensitivity(step, step_slopes, drive_slopes, states, u, c, begins):
    """(samples, n): derivative of c · x by each θ at constant c."""
    order = c.size
    change = np.zeros((u.size, order))
    now, following = np.empty(order), np.empty(order)
    for p in range(order):
        for e in range(begins.size - 1):
            now[:] = 0.0
            for k in range(begins[e], begins[e + 1] - 1):
                output = 0.0
                for i in range(order):
                    total = drive_slopes[p, i] * u[k]
                    for j in range(order):
                        total += step[i, j] * now[j] + step_slopes[p, i, j] * states[k, j]
                    following[i] = total
                    output += c[i] * total
                now[:] = following
                change[k + 1, p] = output
    return change


@njit(cache=True, fastmath=False)
def _powers(step, first, length):
    order = first.size
    rows = np.empty((length, order))
    rows[0] = first
    for k in range(length - 1):
        for i in range(order):
            total = 0.0
            for j in range(order):
                total += step[i, j] * rows[k, j]
            rows[k + 1, i] = total
    return rows


@njit(cache=True, fastmath=False)
def _free_slopes(step, step_slopes, first_slopes, rows):
    """(length, n, n): derivative of A_dᵏ b by each θ, the parameter in the middle."""
    length, order = rows.shape
    slopes = np.empty((length, order, order))
    for p in range(order):
        slopes[0, p] = first_slopes[p]
        for k in range(length - 1):
            for i in range(order):
                total = 0.0
                for j in range(order):
                    total += step[i, j] * slopes[k, p, j] + step_slopes[p, i, j] * rows[k, j]
                slopes[k + 1, p, i] = total
    return slopes
