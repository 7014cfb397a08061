"""Compiled integration: exact recursion for linear machines, Runge-Kutta steps for all others.

One set of equations, the rotor's (see `rotor.py`), serves every machine: a motor alone is a rotor
without unbalance, and skips the foundation. The classical fourth-order Runge-Kutta method runs with
steps of fixed length between the switches of the voltage, so that no step ever crosses one: between
switches the right-hand side is smooth and the order holds. Effects join by `terms.py`.

What is compiled copies arrays element by element: an assignment to a slice, with the sentence that
it would fail with, takes seconds to compile.
"""

from __future__ import annotations

import math

import numpy as np

from ldt_core.base.compiled import njit
from ldt_core.physics.lanes import LARGEST_ANGLE, sine_and_cosine
from ldt_core.physics.terms import evaluate, forget, is_quiet

MAX_STEP_RATE = 1.0  # step times fastest rate: RK4 is stable to 2.8, and accurate well below
STATES = 7  # of a machine: motor and foundation
RIGID_STATES = 3  # of one that shakes no foundation
LONGEST_PAUSE = 16  # intervals with short steps, at most, before long ones are tried again
SMALL_TURN = 0.1  # rad; below, the series of `turned` is exact to rounding


@njit(nogil=True)
def propagate(ad, bd, volts, initial, seen, gain):  # pragma: no cover - compiled
    """States of x[k+1] = ad x[k] + bd volts[k]: (L, n).

    With `seen` (L,), else empty, the speed is corrected towards it behind every sample.
    """
    length, n = volts.size, initial.size
    states = np.empty((length, n))
    x, moved = initial.copy(), np.empty(n)
    for k in range(length):
        for i in range(n):
            states[k, i] = x[i]
        if k < seen.size:
            x[1] += gain * (seen[k] - x[1])
        for i in range(n):
            moved[i] = bd[i] * volts[k]
            for j in range(n):
                moved[i] += ad[i, j] * x[j]
        x, moved = moved, x
    return states


@njit(nogil=True)
def lagged(x, decay, now, before):  # pragma: no cover - compiled
    """y[k] = decay y[k-1] + now x[k] + before x[k-1]: (L,), settled at the first sample."""
    y = np.empty_like(x)
    kept = before * x[0] + decay * x[0]
    for k in range(x.size):
        y[k] = kept + now * x[k]
        kept = before * x[k] + decay * y[k]
    return y


@njit(nogil=True)
def answered(x, decay, gain, kept):  # pragma: no cover - compiled
    """Rows y[k] = decay y[k-1] + gain x[k-1]: (L, n), the first `kept` (n,), which moves along."""
    y = np.empty_like(x)
    for k in range(x.shape[0]):
        for j in range(x.shape[1]):
            y[k, j] = kept[j]
            kept[j] = decay * kept[j] + gain * x[k, j]
    return y


@njit(nogil=True)
def turned(s, o, theta, delta):  # pragma: no cover - compiled
    """Sine and cosine of theta + delta from those of theta: a step turns the shaft very little.

    Power series, exact to rounding below SMALL_TURN, at a fifth of the library functions' time.
    """
    if abs(delta) > SMALL_TURN:
        return math.sin(theta + delta), math.cos(theta + delta)
    q = delta * delta
    a = 1 - q * (1 / 20) * (1 - q * (1 / 42) * (1 - q * (1 / 72)))
    a = delta - delta * q * (1 / 6) * a
    b = 1 - q * (1 / 30) * (1 - q * (1 / 56) * (1 - q * (1 / 90)))
    b = 1 - q * 0.5 * (1 - q * (1 / 12) * b)
    return s * b + o * a, o * b - s * a


# A state y is a tuple of three numbers (a machine that shakes no foundation) or of seven. The
# compiler resolves `len(y)`, so either length becomes machine code of its own.


@njit(nogil=True)
def _direction(y):  # pragma: no cover - compiled
    """Sine and cosine of the angle, which three states do not need."""
    if len(y) == RIGID_STATES:
        return 0.0, 1.0
    if abs(y[0]) > LARGEST_ANGLE:
        return math.sin(y[0]), math.cos(y[0])
    return sine_and_cosine(y[0])  # as lanes take it


@njit(nogil=True)
def _turned(y, s, o, delta):  # pragma: no cover - compiled
    if len(y) == RIGID_STATES:
        return s, o
    return turned(s, o, y[0], delta)


@njit(nogil=True)
def _rates(y, s, o, torque, volts, c):  # pragma: no cover - compiled
    omega, current = y[1], y[2]
    alpha = c.pull * current - c.drag * omega + c.ease * torque
    di = c.supply * volts - c.loss * current - c.emf * omega
    if len(y) == RIGID_STATES:
        return omega, alpha, di
    fx = -c.damping_x * y[4] - c.stiffness_x * y[3]
    fz = -c.damping_y * y[6] - c.stiffness_y * y[5]
    alpha += c.coupling * (fx * s - fz * o) - c.weight * o
    spin = omega * omega
    ax = fx + c.lever * (alpha * s + spin * o)
    az = fz + c.lever * (spin * s - alpha * o)
    return omega, alpha, di, y[4], ax, y[6], az


@njit(nogil=True)
def _moved(y, h, k):  # pragma: no cover - compiled
    a, b, c = y[0] + h * k[0], y[1] + h * k[1], y[2] + h * k[2]
    if len(y) == RIGID_STATES:
        return a, b, c
    return a, b, c, y[3] + h * k[3], y[4] + h * k[4], y[5] + h * k[5], y[6] + h * k[6]


@njit(nogil=True)
def _summed(a, b, c, d):  # pragma: no cover - compiled
    x = a[0] + 2 * (b[0] + c[0]) + d[0]
    y = a[1] + 2 * (b[1] + c[1]) + d[1]
    z = a[2] + 2 * (b[2] + c[2]) + d[2]
    if len(a) == RIGID_STATES:
        return x, y, z
    return (
        x,
        y,
        z,
        a[3] + 2 * (b[3] + c[3]) + d[3],
        a[4] + 2 * (b[4] + c[4]) + d[4],
        a[5] + 2 * (b[5] + c[5]) + d[5],
        a[6] + 2 * (b[6] + c[6]) + d[6],
    )


@njit(nogil=True)
def _corrected(y, change):  # pragma: no cover - compiled
    if len(y) == RIGID_STATES:
        return y[0], y[1] + change, y[2]
    return y[0], y[1] + change, y[2], y[3], y[4], y[5], y[6]


@njit(nogil=True)
def _is_finite(y, z):  # pragma: no cover - compiled
    total = z.sum()
    for i in range(len(y)):
        total += y[i]
    return math.isfinite(total)


@njit(nogil=True)
def runge_kutta(
    edges, volts, steps, long, samples, first, own, c, states, seen, gain, terms
):  # pragma: no cover - compiled
    """Fill `states` (L, 7 + own); return the index of the first sample that is not finite, or -1.

    Where `long` has fewer steps than `steps`, those are tried first: a watched term is steep, but
    rarely where the machine is. If it turns out to be, the interval is run again.

    Args:
        edges, volts: (K + 1,) ends of the intervals of constant voltage [s], (K,) the voltage [V].
        steps, long: (K,) steps in each interval, fewer to try first.
        samples: (K + 1,) sample at each edge, or -1.
        first, own: at the first edge the machine's state, three or seven numbers, and the effects'
            (own,), which is overwritten.
        c: `motor_driven.Coefficients`.
        states: (L, 7 + own), first row given.
        seen, gain: (L,) speeds to follow [rad/s] or empty, and the part taken at a sample.
        terms: `Terms` of the effects, or None.
    """
    y, z = first, own
    if seen.size > 0:
        y = _corrected(y, gain * (seen[0] - y[1]))
    moved = z.copy()
    d1, d2, d3, d4 = z.copy(), z.copy(), z.copy(), z.copy()
    before, kept = y, z.copy()
    k, wait, pause, again = 0, 0, 1, False
    while k < volts.size:
        v = volts[k]
        trial = long[k] < steps[k] and wait == 0 and not again
        count = long[k] if trial else steps[k]
        if trial:
            before = y
            for i in range(z.size):
                kept[i] = z[i]
            forget(terms)
        h = (edges[k + 1] - edges[k]) / count
        half, sixth = h / 2, h / 6
        s, o = _direction(y)  # anew, so that rounding does not add up
        for step in range(count):
            t = edges[k] + step * h
            torque, u = evaluate(terms, t, y, v, z, d1)
            k1 = _rates(y, s, o, torque, u, c)
            w = _moved(y, half, k1)
            s2, o2 = _turned(y, s, o, half * k1[0])
            for i in range(z.size):
                moved[i] = z[i] + half * d1[i]
            torque, u = evaluate(terms, t + half, w, v, moved, d2)
            k2 = _rates(w, s2, o2, torque, u, c)
            w = _moved(y, half, k2)
            s3, o3 = _turned(y, s, o, half * k2[0])
            for i in range(z.size):
                moved[i] = z[i] + half * d2[i]
            torque, u = evaluate(terms, t + half, w, v, moved, d3)
            k3 = _rates(w, s3, o3, torque, u, c)
            w = _moved(y, h, k3)
            s4, o4 = _turned(y, s, o, h * k3[0])
            for i in range(z.size):
                moved[i] = z[i] + h * d3[i]
            torque, u = evaluate(terms, t + h, w, v, moved, d4)
            k4 = _rates(w, s4, o4, torque, u, c)
            total = _summed(k1, k2, k3, k4)
            s, o = _turned(y, s, o, sixth * total[0])
            y = _moved(y, sixth, total)
            for i in range(z.size):
                z[i] += sixth * (d1[i] + 2 * (d2[i] + d3[i]) + d4[i])
        if trial:
            again = not (is_quiet(terms) and _is_finite(y, z))
            if again:
                y = before
                for i in range(z.size):
                    z[i] = kept[i]
                wait, pause = pause, min(2 * pause, LONGEST_PAUSE)
                continue
            pause = 1
        again, wait, k = False, max(wait - 1, 0), k + 1
        at = samples[k]
        if at >= 0:
            for i in range(len(y)):
                states[at, i] = y[i]
            for i in range(z.size):
                states[at, STATES + i] = z[i]
            if not _is_finite(y, z):
                return at
            if seen.size > 0:
                y = _corrected(y, gain * (seen[at] - y[1]))
    return -1
