"""The search for the poles: from a start to the nearest minimum, one pass over the samples a trial.

A pass makes the columns of the least squares sample by sample and adds up their products, so no
column is ever stored. Columns, for a model of n states:

    w  n  rows A_dᵏ b, what an unknown start state adds (its own for each experiment)
    x  n  states from zero
    u  1  the input, where it feeds through
    1  1  an offset, where there is one
    J  n  derivative of the free run by θ (second pass only)
    y  1  the output, or what is left of it (second pass)

Products lose half the digits of a residual that is small against the output. Hence two passes: the
first finds the linear parameters, the second makes the residual itself, sample by sample. Products
are added up by segment (a part of an experiment), so that segments can be left out afterwards.

The linear parameters of a trial are foretold from the last one, to first order, and corrected by
what the pass finds left over. So its loss is exact although they were not solved for beforehand,
and its derivative becomes exact as the corrections fade.

The damping is that of K. Madsen, H. B. Nielsen, O. Tingleff, "Methods for non-linear least squares
problems" (2004). Parameters at a bound that the descent pushes against stay there. What is compiled
loops over elements: each assignment to a slice would take a second to compile.
"""

from __future__ import annotations

import numpy as np

from ldt_core.base.compiled import njit
from ldt_core.estimation.linear import schwarz

#: Share of a column's square that the columns before it leave, at least: less is rounding (products
#: are exact to 1e-16), and the column's coefficient stays 0.
RANK_TOLERANCE = 1e-13
#: Damping at the start relative to the largest curvature: nearly a Gauss-Newton step.
FIRST_DAMPING = 1e-4
#: [logarithm] Longest step of a component of θ: beyond e² the linearisation says nothing.
LONGEST_STEP = 2.0
#: Change of θ that ends the search: 1e-9 of a pole.
THETA_TOLERANCE = 1e-9


@njit(fastmath=False)
def _first_pass(step, drive, first, u, y, begins, cuts, offset):
    """(segments, m, m) products of the columns w, x, 1, y; the upper triangle.

    Args:
        step, drive, first: A_d (n, n), b_d (n,), b (n,).
        u, y: (samples,) input and output of all experiments, one after the other.
        begins: (experiments + 1,) where each begins, and the end.
        cuts: (segments + 1,) where each segment begins, the experiments' begins among them.
        offset: whether there is a column 1.
    """
    n = drive.size
    m = 2 * n + offset + 1
    grams = np.zeros((cuts.size - 1, m, m))
    row, following = np.empty(m), np.empty(2 * n)
    experiment = 0
    for s in range(cuts.size - 1):
        gram = grams[s]
        if cuts[s] == begins[experiment]:
            experiment += 1
            for i in range(n):
                row[i], row[n + i] = first[i], 0.0
            if offset:
                row[m - 2] = 1.0
        for k in range(cuts[s], cuts[s + 1]):
            row[m - 1] = y[k]
            for i in range(m):
                factor = row[i]
                for j in range(i, m):
                    gram[i, j] += factor * row[j]
            for i in range(n):
                free, forced = 0.0, drive[i] * u[k]
                for j in range(n):
                    free += step[i, j] * row[j]
                    forced += step[i, j] * row[n + j]
                following[i], following[n + i] = free, forced
            for i in range(2 * n):
                row[i] = following[i]
    return grams


@njit(fastmath=False)
def _second_pass(step, drive, first, steps, drives, firsts, linear, v, u, y, begins, cuts, offset):
    """(segments, m, m) products of the columns w, x, 1, J and the residual; upper triangle.

    `steps`, `drives` and `firsts` are the derivatives by θ, the parameter first, `linear` the
    weights of the columns x and 1, `v` (experiments, n) those of the columns w.
    """
    n = drive.size
    base = 2 * n + offset
    m = base + n + 1
    grams = np.zeros((cuts.size - 1, m, m))
    row, following = np.empty(m), np.empty(2 * n)
    free, forced = np.empty((n, n)), np.empty((n, n))
    free_next, forced_next = np.empty((n, n)), np.empty((n, n))
    experiment = 0
    for s in range(cuts.size - 1):
        gram = grams[s]
        if cuts[s] == begins[experiment]:
            for i in range(n):
                row[i], row[n + i] = first[i], 0.0
                for p in range(n):
                    free[p, i], forced[p, i] = firsts[p, i], 0.0
            if offset:
                row[base - 1] = 1.0
            own = v[experiment]
            experiment += 1
        for k in range(cuts[s], cuts[s + 1]):
            left = y[k]
            for i in range(n):
                left -= own[i] * row[i]
            for i in range(base - n):
                left -= linear[i] * row[n + i]
            row[m - 1] = left
            for p in range(n):
                change = 0.0
                for i in range(n):
                    change += own[i] * free[p, i] + linear[i] * forced[p, i]
                row[base + p] = change
            for i in range(m):
                factor = row[i]
                for j in range(i, m):
                    gram[i, j] += factor * row[j]
            for p in range(n):
                for i in range(n):
                    a, b = 0.0, drives[p, i] * u[k]
                    for j in range(n):
                        a += step[i, j] * free[p, j] + steps[p, i, j] * row[j]
                        b += step[i, j] * forced[p, j] + steps[p, i, j] * row[n + j]
                    free_next[p, i], forced_next[p, i] = a, b
            free, free_next = free_next, free
            forced, forced_next = forced_next, forced
            for i in range(n):
                a, b = 0.0, drive[i] * u[k]
                for j in range(n):
                    a += step[i, j] * row[j]
                    b += step[i, j] * row[n + j]
                following[i], following[n + i] = a, b
            for i in range(2 * n):
                row[i] = following[i]
    return grams


@njit(fastmath=False)
def eliminate(grams, kept, owners, experiments, n):
    """Take the start states out of the products of the segments that are kept.

    Args:
        grams: (segments, m, m), upper triangles.
        kept, owners: (segments,) whether each counts, and the experiment that it is of.
        experiments, n: how many there are of them and of columns w.

    Returns:
        (m − n, m − n) products of the other columns less what start states explain of them, and
        (experiments, n, m − n) the start states that explain it.
    """
    m = grams.shape[1]
    rest = np.zeros((m - n, m - n))
    states = np.zeros((experiments, n, m - n))
    gram = np.empty((m, m))
    s = 0
    for e in range(experiments):
        for i in range(m):
            for j in range(m):
                gram[i, j] = 0.0
        while s < owners.size and owners[s] == e:
            if kept[s]:
                for i in range(m):
                    for j in range(i, m):
                        gram[i, j] += grams[s, i, j]
            s += 1
        for i in range(m):
            for j in range(i):
                gram[i, j] = gram[j, i]
        _solve(gram, n)
        for j in range(m - n):
            for i in range(m - n):
                rest[i, j] += gram[n + i, n + j]
            for i in range(n):
                states[e, i, j] = gram[i, n + j]
    return rest, states


@njit(fastmath=False)
def _solve(gram, count):
    """Gauss and Jordan, in place, over the first columns of a matrix of products.

    Their rows then hold what each of the other columns takes of them; the rows below hold the
    products of what is left of the other columns.
    """
    size = gram.shape[0]
    least = np.empty(count)
    for k in range(count):
        least[k] = RANK_TOLERANCE * gram[k, k]
    for k in range(count):
        pivot = gram[k, k]
        if not pivot > least[k]:
            for i in range(size):
                gram[k, i] = gram[i, k] = 0.0
            continue
        for j in range(k, size):
            gram[k, j] /= pivot
        for i in range(size):
            if i != k:
                factor = gram[i, k]
                if factor != 0.0:
                    for j in range(k, size):
                        gram[i, j] -= factor * gram[k, j]


def linear_part(theta, sigma, u, y, begins, cuts, kept, owners, offset):
    """Weights of the columns x and 1 that are best at θ, those of w, and the loss."""
    step, drive, first = schwarz.discrete(theta, sigma)
    grams = _first_pass(step, drive, first, u, y, begins, cuts, offset)
    rest, states = eliminate(grams, kept, owners, begins.size - 1, theta.size)
    count = rest.shape[0] - 1
    _solve(rest, count)
    nothing = np.zeros(0)
    linear, v = corrected(np.zeros(count), np.zeros(states.shape[:2]), rest, states, nothing)
    return linear, v, rest[count, count]


def tangent(theta, sigma, linear, v, u, y, begins, cuts, kept, owners, offset):
    """(segments, m, m) products of all columns at θ and some weights, J and residual included."""
    system = schwarz.discrete_slopes(theta, sigma)
    return _second_pass(*system, linear, v, u, y, begins, cuts, offset)


def solved(grams, kept, owners, experiments, n):
    """The least squares that a tangent of n states is, all linear parameters at their best.

    Returns:
        rest: with L weights, `rest[L:, L:]` are the products of J and the residual when nothing
            linear is left in them, and `rest[:L, L:]` is what the weights take of them;
        states: (experiments, n, L + n + 1) what start states take of the columns.
    """
    rest, states = eliminate(grams, kept, owners, experiments, n)
    _solve(rest, rest.shape[0] - n - 1)
    return rest, states


@njit(fastmath=False)
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


@njit(fastmath=False)
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


@njit(fastmath=False)
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
    _solve(system, size)
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
    sigma, u, y, begins, cuts, kept, owners, offset,
):  # fmt: skip
    """(θ, sum of squares) after so many passes or when nothing is gained any more.

    Args:
        theta: (n,) start, between the bounds `low` and `high` (n,).
        steps: passes at most.
        tolerance: relative gain below which the search ends.
        (others): as for `tangent`.
    """
    n, experiments = theta.size, begins.size - 1
    linear, v, _ = linear_part(theta, sigma, u, y, begins, cuts, kept, owners, offset)
    grams = tangent(theta, sigma, linear, v, u, y, begins, cuts, kept, owners, offset)
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
            u, y, begins, cuts, kept, owners, offset,
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
