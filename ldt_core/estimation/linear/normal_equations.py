"""The search's inner loops: one pass over the samples, then matrices of a few rows.

Loops over elements throughout: each assignment to a slice would take a second to compile.

A pass makes the columns of the least squares sample by sample and adds up their products, so no
column is ever stored. Columns, for a model of n states:

    w  n  rows A_dᵏ b, what an unknown start state adds (its own for each experiment)
    x  n  states from zero
    u  1  the input, where it feeds through
    1  1  an offset, where there is one
    J  n  derivative of the free run by θ (second pass only)
    y  1  the output, or what is left of it (second pass)

Products lose half the digits of a residual that is small against the output. Hence two passes: the
first finds the linear parameters, the second makes the residual itself, sample by sample, and the
products of that are as good as the residual. Products are added up by segment (a part of an
experiment), so that segments can be left out afterwards.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: Share of a column's square that the columns before it leave, at least: less is rounding (products
#: are exact to 1e-16), and the column's coefficient stays 0.
RANK_TOLERANCE = 1e-13


@njit(cache=True, fastmath=False)
def first_pass(step, drive, first, u, y, begins, cuts, feedthrough, offset):
    """(segments, m, m) products of the columns w, x, u, 1, y; the upper triangle.

    Args:
        step: A_d (n, n).
        drive: b_d (n,).
        first: b (n,).
        u: (samples,) input of all experiments, one after the other.
        y: (samples,) output.
        begins: (experiments + 1,) where each begins, and the end.
        cuts: (segments + 1,) where each segment begins, the experiments' begins among them.
        feedthrough: whether there is a column u.
        offset: whether there is a column 1.
    """
    n = drive.size
    m = 2 * n + feedthrough + offset + 1
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
            if feedthrough:
                row[2 * n] = u[k]
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


@njit(cache=True, fastmath=False)
def second_pass(
    step, drive, first, steps, drives, firsts, linear, v, u, y, begins, cuts, feedthrough, offset
):
    """(segments, m, m) products of the columns w, x, u, 1, J and the residual; upper triangle.

    Args:
        steps: derivatives of `step` by θ, the parameter first (n, n, n).
        drives: of `drive` (n, n).
        firsts: of `first` (n, n).
        linear: weights of the columns x, u and 1.
        v: (experiments, n) weights of the columns w.
        (others): as for `first_pass`.
    """
    n = drive.size
    base = 2 * n + feedthrough + offset
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
            if feedthrough:
                row[2 * n] = u[k]
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


@njit(cache=True, fastmath=False)
def eliminate(grams, kept, owners, experiments, n):
    """Take the start states out of the products of the segments that are kept.

    Args:
        grams: (segments, m, m), upper triangles.
        kept: (segments,) which of them count.
        owners: (segments,) experiment of each.
        experiments: how many there are.
        n: number of columns w.

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
        solve(gram, n)
        for j in range(m - n):
            for i in range(m - n):
                rest[i, j] += gram[n + i, n + j]
            for i in range(n):
                states[e, i, j] = gram[i, n + j]
    return rest, states


@njit(cache=True, fastmath=False)
def solve(gram, count):
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
