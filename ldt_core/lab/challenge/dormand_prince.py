"""Dormand and Prince's explicit pair of order 5(4) with adaptive steps (J. Comput. Appl. Math. 6
(1980) 19), restarted wherever the voltage switches.
"""

from __future__ import annotations

import numpy as np

from ldt_core.base.compiled import njit
from ldt_core.lab.challenge.equations import rates

TOLERANCE = 1e-8  # relative, on each step's local error
FIRST_STEP = 1e-4  # s, tried first
SAFETY, LEAST, MOST = 0.9, 0.2, 5.0  # a step's length over the one before
MAX_STEPS = 3_000_000  # of one run; a machine that needs more is none that anybody built


@njit(error_model="numpy")
def integrate(
    edges, volts, keep, y, p, active, tolerances, tolerance
):  # pragma: no cover - compiled
    """States at the kept edges.

    Args:
        edges: (E + 1,) times [s] between which the voltage is constant.
        volts: (E,) [V].
        keep: (E + 1,) whether to return the state at the edge.
        y: (n,) state at the first edge.
        p: the machine's record.
        active: indices of the states that move; the others stay.
        tolerances: (n,) absolute, on each state.
        tolerance: relative.

    Returns:
        (kept, n) states, whether all went well.
    """
    n = y.size
    states = np.empty((keep.sum(), n))
    y = y.copy()
    row = 0
    if keep[0]:
        for i in range(n):
            states[0, i] = y[i]
        row = 1
    k1, k2, k3, k4 = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    k5, k6, k7, w = np.zeros(n), np.zeros(n), np.zeros(n), y.copy()
    h, steps = FIRST_STEP, 0
    for e in range(volts.size):
        t, end, v = edges[e], edges[e + 1], volts[e]
        rates(t, y, v, p, k1)
        while t < end:
            steps += 1
            if steps > MAX_STEPS:
                return states, False
            last = t + h * 1.000001 >= end
            d = end - t if last else h
            for j in active:
                w[j] = y[j] + d * (k1[j] / 5)
            rates(t + d / 5, w, v, p, k2)
            for j in active:
                w[j] = y[j] + d * (3 / 40 * k1[j] + 9 / 40 * k2[j])
            rates(t + d * 3 / 10, w, v, p, k3)
            for j in active:
                w[j] = y[j] + d * (44 / 45 * k1[j] - 56 / 15 * k2[j] + 32 / 9 * k3[j])
            rates(t + d * 4 / 5, w, v, p, k4)
            for j in active:
                w[j] = y[j] + d * (
                    19372 / 6561 * k1[j]
                    - 25360 / 2187 * k2[j]
                    + 64448 / 6561 * k3[j]
                    - 212 / 729 * k4[j]
                )
            rates(t + d * 8 / 9, w, v, p, k5)
            for j in active:
                w[j] = y[j] + d * (
                    9017 / 3168 * k1[j]
                    - 355 / 33 * k2[j]
                    + 46732 / 5247 * k3[j]
                    + 49 / 176 * k4[j]
                    - 5103 / 18656 * k5[j]
                )
            rates(t + d, w, v, p, k6)
            for j in active:
                w[j] = y[j] + d * (
                    35 / 384 * k1[j]
                    + 500 / 1113 * k3[j]
                    + 125 / 192 * k4[j]
                    - 2187 / 6784 * k5[j]
                    + 11 / 84 * k6[j]
                )
            rates(t + d, w, v, p, k7)
            worst = 0.0
            for j in active:
                error = d * (
                    71 / 57600 * k1[j]
                    - 71 / 16695 * k3[j]
                    + 71 / 1920 * k4[j]
                    - 17253 / 339200 * k5[j]
                    + 22 / 525 * k6[j]
                    - k7[j] / 40
                )
                size = tolerances[j] + tolerance * max(abs(y[j]), abs(w[j]))
                worst = max(worst, abs(error) / size)
            if not worst < np.inf:  # also what is not a number
                if d < 1e-12:
                    return states, False
                h = d * LEAST
                continue
            factor = MOST if worst == 0.0 else min(MOST, max(LEAST, SAFETY * worst**-0.2))
            if worst <= 1.0:
                t = end if last else t + d
                for j in active:
                    y[j] = w[j]
                    k1[j] = k7[j]
                # A step cut short by an edge says nothing against the one before.
                h = max(h, d * factor) if last and factor >= 1.0 else d * factor
            else:
                h = d * factor
        if keep[e + 1]:
            for i in range(n):
                states[row, i] = y[i]
            row += 1
    return states, True
