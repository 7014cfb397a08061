"""Explicit steps of eight free runs whose current is faster than the steps.

Speed and current of the ideal motor move by the exact exponential of their equations, A; what acts
beside, N, moves them by a fourth-order Runge-Kutta method about that (Cox, Matthews, Exponential
time differencing for stiff systems, J. Comput. Phys. 176 (2002) 430, equations 26 to 29), which is
the classical method for A = 0. It is exact for the ideal motor, and stable for any L.

Where a foundation moves, the shaft's acceleration, and with it the fast current, would shake it. So
the momenta of shaft and foundation together are integrated, in place of the foundation's speeds:
what changes them is the foundation's own force, which knows nothing of the current. A term must not
either, see `motor_driven.planned`; `fast_current.collocate` serves those that do.
"""

from __future__ import annotations

import numpy as np

from ldt_core.base.compiled import njit
from ldt_core.physics.integrate import RIGID_STATES
from ldt_core.physics.lane_steps import direction, turned
from ldt_core.physics.lane_terms import evaluate_lanes
from ldt_core.physics.lanes import WIDTH, load, store
from ldt_core.physics.motor_functions import motor_functions

NUMBERS = 20  # of `exponential_moves` for one step length


@njit(nogil=True)
def exponential_moves(c, steps):  # pragma: no cover - compiled
    """(steps, NUMBERS, WIDTH) of machines with (13, WIDTH) `Coefficients`, for step lengths [s].

    Over half of a step the states on the states (4), an acceleration beside on the states (2), the
    voltage on them (2); the same (8) over all of it, the acceleration that of the first stage;
    then those of the second and third (2), and of the fourth (2).
    """
    found = np.empty((steps.size, NUMBERS, WIDTH))
    f = np.empty((4, 2, 2))
    for i in range(steps.size):
        for j in range(WIDTH):
            supply, row = c[5, j], found[i, :, j]
            for part in range(2):
                h, at = steps[i] / (2 - part), 8 * part
                motor_functions(c[0, j], c[1, j], c[7, j], c[6, j], h, f)
                for p in range(2):
                    row[at + 2 * p], row[at + 2 * p + 1] = f[0, p, 0], f[0, p, 1]
                    row[at + 4 + p] = h * f[1, p, 0]
                    row[at + 6 + p] = h * supply * f[1, p, 1]
            for p in range(2):
                row[12 + p] = h * (f[1, p, 0] - 3 * f[2, p, 0] + 4 * f[3, p, 0])
                row[16 + p] = h * (2 * f[2, p, 0] - 4 * f[3, p, 0])
                row[18 + p] = h * (4 * f[3, p, 0] - f[2, p, 0])
    return found


@njit(nogil=True)
def _to_momenta(y, s, o, c):  # pragma: no cover - compiled
    if len(y) == RIGID_STATES:
        return y
    turning = c.lever * y[1]
    return y[0], y[1], y[2], y[3], y[4] - turning * s, y[5], y[6] + turning * o


@njit(nogil=True)
def _to_speeds(y, s, o, c):  # pragma: no cover - compiled
    if len(y) == RIGID_STATES:
        return y
    turning = c.lever * y[1]
    return y[0], y[1], y[2], y[3], y[4] + turning * s, y[5], y[6] - turning * o


@njit(nogil=True)
def _outer(y, s, o, torque, c):  # pragma: no cover - compiled
    """(acceleration beside the ideal motor's, rates of the states but speed and current)."""
    if len(y) == RIGID_STATES:
        return c.ease * torque, (y[1],)
    turning = c.lever * y[1]
    vx, vz = y[4] + turning * s, y[6] - turning * o
    fx = -c.damping_x * vx - c.stiffness_x * y[3]
    fz = -c.damping_y * vz - c.stiffness_y * y[5]
    n = c.ease * torque + c.coupling * (fx * s - fz * o) - c.weight * o
    return n, (y[1], vx, fx, vz, fz)


@njit(nogil=True)
def _at(y, h, k, omega, current):  # pragma: no cover - compiled
    """y moved by h k, speed and current as given."""
    angle = y[0] + h * k[0]
    if len(y) == RIGID_STATES:
        return angle, omega, current
    x, px, z, pz = y[3] + h * k[1], y[4] + h * k[2], y[5] + h * k[3], y[6] + h * k[4]
    return angle, omega, current, x, px, z, pz


@njit(nogil=True)
def _summed(a, b, c, d):  # pragma: no cover - compiled
    first = a[0] + 2 * (b[0] + c[0]) + d[0]
    if len(a) == 1:
        return (first,)
    return (
        first,
        a[1] + 2 * (b[1] + c[1]) + d[1],
        a[2] + 2 * (b[2] + c[2]) + d[2],
        a[3] + 2 * (b[3] + c[3]) + d[3],
        a[4] + 2 * (b[4] + c[4]) + d[4],
    )


@njit(nogil=True)
def _four(moves, at):  # pragma: no cover - compiled
    return load(moves, at), load(moves, at + 1), load(moves, at + 2), load(moves, at + 3)


@njit(nogil=True)
def exponential_interval(
    y, begin, length, count, v, c, terms, moves, which, z
):  # pragma: no cover - compiled
    """As `lane_steps.interval`; `moves` of `exponential_moves`, `which` of its step lengths."""
    h = length / count
    half, sixth = h / 2, h / 6
    own, at = z.shape[1], which * NUMBERS
    z0, moved, d1, d2, d3, d4 = z[0], z[1], z[2], z[3], z[4], z[5]
    e11, e12, e21, e22 = _four(moves, at)
    p1, p2, q1, q2 = _four(moves, at + 4)
    f11, f12, f21, f22 = _four(moves, at + 8)
    a1, a2, r1, r2 = _four(moves, at + 12)
    b1, b2, l1, l2 = _four(moves, at + 16)
    q1, q2, r1, r2 = q1 * v, q2 * v, r1 * v, r2 * v
    s, o = direction(y)
    y = _to_momenta(y, s, o, c)
    for step in range(count):
        t = begin + step * h
        torque, _ = evaluate_lanes(terms, t, y, v, z0, d1)
        n1, k1 = _outer(y, s, o, torque, c)
        free1 = e11 * y[1] + e12 * y[2] + q1
        free2 = e21 * y[1] + e22 * y[2] + q2
        first = _at(y, half, k1, free1 + p1 * n1, free2 + p2 * n1)
        s2, o2 = turned(y, s, o, half * k1[0])
        for i in range(own):
            store(moved, i, load(z0, i) + half * load(d1, i))
        torque, _ = evaluate_lanes(terms, t + half, first, v, moved, d2)
        n2, k2 = _outer(first, s2, o2, torque, c)
        w = _at(y, half, k2, free1 + p1 * n2, free2 + p2 * n2)
        s3, o3 = turned(y, s, o, half * k2[0])
        for i in range(own):
            store(moved, i, load(z0, i) + half * load(d2, i))
        torque, _ = evaluate_lanes(terms, t + half, w, v, moved, d3)
        n3, k3 = _outer(w, s3, o3, torque, c)
        n = 2 * n3 - n1
        speed = e11 * first[1] + e12 * first[2] + p1 * n + q1
        w = _at(y, h, k3, speed, e21 * first[1] + e22 * first[2] + p2 * n + q2)
        s4, o4 = turned(y, s, o, h * k3[0])
        for i in range(own):
            store(moved, i, load(z0, i) + h * load(d3, i))
        torque, _ = evaluate_lanes(terms, t + h, w, v, moved, d4)
        n4, k4 = _outer(w, s4, o4, torque, c)
        n = n2 + n3
        speed = f11 * y[1] + f12 * y[2] + r1 + a1 * n1 + b1 * n + l1 * n4
        current = f21 * y[1] + f22 * y[2] + r2 + a2 * n1 + b2 * n + l2 * n4
        total = _summed(k1, k2, k3, k4)
        s, o = turned(y, s, o, sixth * total[0])
        y = _at(y, sixth, total, speed, current)
        for i in range(own):
            rise = load(d1, i) + 2 * (load(d2, i) + load(d3, i)) + load(d4, i)
            store(z0, i, load(z0, i) + sixth * rise)
    return _to_speeds(y, s, o, c)
