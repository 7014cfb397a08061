"""The search itself: from a start to the nearest minimum, one pass a trial.

The linear parameters of a trial are foretold from the last one, to first order, and corrected by
what the pass finds left over. So its loss is exact although they were not solved for beforehand,
and its derivative becomes exact as the corrections fade.

The damping is that of K. Madsen, H. B. Nielsen, O. Tingleff, "Methods for non-linear least squares
problems" (2004). Parameters at a bound that the descent pushes against stay there.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ldt_core.estimation.linear import schwarz
from ldt_core.estimation.linear.normal_equations import eliminate, first_pass, second_pass, solve

#: Damping at the start relative to the largest curvature: nearly a Gauss-Newton step.
FIRST_DAMPING = 1e-4
#: [logarithm] Longest step of a component of θ: beyond e² the linearisation says nothing.
LONGEST_STEP = 2.0
#: Change of θ that ends the search: 1e-9 of a pole.
THETA_TOLERANCE = 1e-9


def linear_part(theta, sigma, u, y, begins, cuts, kept, owners, feedthrough, offset):
    """Weights of the columns x, u and 1 that are best at θ, those of w, and the loss."""
    step, drive, first = schwarz.discrete(theta, sigma)
    grams = first_pass(step, drive, first, u, y, begins, cuts, feedthrough, offset)
    rest, states = eliminate(grams, kept, owners, begins.size - 1, theta.size)
    count = rest.shape[0] - 1
    solve(rest, count)
    nothing = np.zeros(0)
    linear, v = corrected(np.zeros(count), np.zeros(states.shape[:2]), rest, states, nothing)
    return linear, v, rest[count, count]


def tangent(theta, sigma, linear, v, u, y, begins, cuts, kept, owners, feedthrough, offset):
    """(segments, m, m) products of all columns at θ and some weights, J and residual included."""
    system = schwarz.discrete_slopes(theta, sigma)
    return second_pass(*system, linear, v, u, y, begins, cuts, feedthrough, offset)


def solved(grams, kept, owners, experiments, n):
    """The least squares that a tangent of n states is, all linear parameters at their best.

    Returns:
        rest: with L weights, `rest[L:, L:]` are the products of J and the residual when nothing
            linear is left in them, and `rest[:L, L:]` is what the weights take of them;
        states: (experiments, n, L + n + 1) what start states take of the columns.
    """
    rest, states = eliminate(grams, kept, owners, experiments, n)
    solve(rest, rest.shape[0] - n - 1)
    return rest, states


@njit(cache=True, fastmath=False)
def corrected(linear, v, rest, states, change):
    """(weights, start states) to first order where θ changes by that (n,), or () for not at all."""
    count = linear.size
    last = rest.shape[1] - 1
    better, others = np.empty(count), np.empty(v.shape)
    for i in range(count):
        more = rest[i, last]
        for p in range(change.size):
            more -= rest[i, count + p] * change[p]
        better[i] = linear[i] + more
    for e in range(v.shape[0]):
        for i in range(v.shape[1]):
            more = states[e, i, last]
            for p in range(change.size):
                more -= states[e, i, count + p] * change[p]
            for j in range(count):
                more -= states[e, i, j] * (better[j] - linear[j])
            others[e, i] = v[e, i] + more
    return better, others


@njit(cache=True, fastmath=False)
def left_over(grams, owners, rest, states, count):
    """(segments,) sums of squared residuals once the linear parameters are corrected."""
    size = grams.shape[1]
    n = states.shape[1]
    nothing = np.zeros(0)
    linear, v = corrected(np.zeros(count), np.zeros(states.shape[:2]), rest, states, nothing)
    squares, weights = np.zeros(owners.size), np.zeros(size)
    weights[size - 1] = 1.0
    for i in range(count):
        weights[n + i] = -linear[i]
    for s in range(owners.size):
        for i in range(n):
            weights[i] = -v[owners[s], i]
        for i in range(size):
            for j in range(size):
                squares[s] += weights[i] * weights[j] * grams[s, min(i, j), max(i, j)]
    for s in range(owners.size):
        squares[s] = max(squares[s], 0.0)  # rounding
    return squares


@njit(cache=True, fastmath=False)
def newton(rest, theta, low, high, damping):
    """(n,) the damped step within the bounds, and by how much it promises to lower the loss."""
    n = theta.size
    count = rest.shape[0] - n - 1
    curvature, descent = rest[count : count + n, count : count + n], rest[count : count + n, -1]
    free, size = np.empty(n, dtype=np.int64), 0
    for i in range(n):
        below = theta[i] <= low[i] and descent[i] < 0
        if not (below or (theta[i] >= high[i] and descent[i] > 0)):
            free[size] = i
            size += 1
    system = np.zeros((size + 1, size + 1))
    for i in range(size):
        for j in range(size):
            system[i, j] = curvature[free[i], free[j]]
        system[i, i] += damping
        system[i, size] = descent[free[i]]
    solve(system, size)
    change, longest = np.zeros(n), 0.0
    for i in range(size):
        change[free[i]] = system[i, size]
        longest = max(longest, abs(system[i, size]))
    if longest > LONGEST_STEP:
        for i in range(n):
            change[i] *= LONGEST_STEP / longest
    promised = 0.0
    for i in range(n):
        change[i] = min(max(theta[i] + change[i], low[i]), high[i]) - theta[i]
    for i in range(n):
        promised += 2 * change[i] * descent[i]
        for j in range(n):
            promised -= change[i] * curvature[i, j] * change[j]
    return change, promised


def first_damping(rest, n):
    """Little against the largest curvature."""
    count = rest.shape[0] - n - 1
    return FIRST_DAMPING * float(np.diag(rest)[count : count + n].max())


def descend(
    theta, low, high, steps, tolerance,
    sigma, u, y, begins, cuts, kept, owners, feedthrough, offset,
):  # fmt: skip
    """(θ, sum of squares) after so many passes or when nothing is gained any more.

    Args:
        theta: (n,) start, between the bounds.
        low, high: (n,) bounds.
        steps: passes at most.
        tolerance: relative gain below which the search ends.
        (others): as for `tangent`.
    """
    n, experiments = theta.size, begins.size - 1
    linear, v, _ = linear_part(theta, sigma, u, y, begins, cuts, kept, owners, feedthrough, offset)
    grams = tangent(theta, sigma, linear, v, u, y, begins, cuts, kept, owners, feedthrough, offset)
    rest, states = solved(grams, kept, owners, experiments, n)
    damping, growth = first_damping(rest, n), 2.0
    for _ in range(steps - 1):
        loss = float(rest[-1, -1])
        change, promised = newton(rest, theta, low, high, damping)
        if not loss > 0 or not change.any():
            break
        trial = theta + change
        trial_linear, trial_v = corrected(linear, v, rest, states, change)
        grams = tangent(
            trial, sigma, trial_linear, trial_v,
            u, y, begins, cuts, kept, owners, feedthrough, offset,
        )  # fmt: skip
        trial_rest, trial_states = solved(grams, kept, owners, experiments, n)
        gained = loss - float(trial_rest[-1, -1])
        if gained > 0:
            theta, linear, v, rest, states = trial, trial_linear, trial_v, trial_rest, trial_states
            if promised > 0:
                damping *= max(1 / 3, 1 - min(2 * gained / promised - 1, 1.0) ** 3)
            growth = 2.0
        else:
            damping *= growth
            growth *= 2
        if np.abs(change).max() <= THETA_TOLERANCE or max(promised, gained) <= tolerance * loss:
            break
    return theta, rest[-1, -1]
