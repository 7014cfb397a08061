"""Integration where the current is faster than the steps: its equation is solved, not stepped over.

Steps of an explicit method would have to follow L/R, which may be nothing at all. Here speed and
current of the ideal motor move by the exact exponential of their equations, A, however fast; what
effects and foundation add, N, is a straight line in time through its values at two points of each
step, which are found together with the state there (collocation at Radau's points; Hochbruck,
Ostermann, Exponential integrators, Acta Numerica 19 (2010), section 2.3):

    x(c h) = exp(c h A) x + integral from 0 to c h of exp((c h - s) A) N(s) ds,  c = 1/3 and 1

It is exact for the ideal motor, of third order in the rest, and stable for any L, since the last
point ends the step and the equations are solved there. A step is cut where N is no straight line
in it: behind a jump of the voltage, and where a term bends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.compiled import njit
from ldt_core.physics.integrate import STATES, _corrected, _direction, _is_finite, _rates
from ldt_core.physics.motor_functions import motor_functions
from ldt_core.physics.terms import evaluate

CUTS = 2  # halvings at once: a jump or a bend asks for several
EASE = 1 / 8  # of the bend that a step may have: of a shorter one, twice as long a step has that
MOST_ROUNDS = 24  # of Newton's method for one step: it needs three or four, or ten at a bend
LEAST_SHARE = 1e-3  # of a Newton step, before the next one is tried
STAYED = 1e-5  # of the effects' states, at their largest: the last change of a step that is solved
ROUNDS_TO_STAY = 4  # in which such states come as near as the method is exact, and a foundation's
SOLVED = 1 / 30  # of `bend`: the last change of a step that is solved
DIFFERENCE = 1e-6  # of the same, for the slopes of the terms: a hundredth of a brush's 0.1 V
SLOW = 0.1  # of the change before: a change that shrinks by less asks for new slopes


class Moves(NamedTuple):
    """How speed and current move in a step, for each step length [i] and halving [j].

    (I, halvings + 1, 2, 2) each: of the states over a third of the step and over all of it; of the
    acceleration [rad/s^2] and voltage [V] at the two points, on the states at the two points.
    """

    third: Array
    whole: Array
    w11: Array
    w12: Array
    w21: Array
    w22: Array


@njit(nogil=True)
def moves(c, lengths, halvings):  # pragma: no cover - compiled
    """The moves of a motor with `Coefficients` c, for (I,) step lengths [s]."""
    shape = (lengths.size, halvings + 1, 2, 2)
    table = Moves(
        np.empty(shape),
        np.empty(shape),
        np.empty(shape),
        np.empty(shape),
        np.empty(shape),
        np.empty(shape),
    )
    third, last = np.empty((4, 2, 2)), np.empty((4, 2, 2))
    for i in range(lengths.size):
        for j in range(halvings + 1):
            h = lengths[i] / 2.0**j
            motor_functions(c.pull, c.drag, c.emf, c.loss, h / 3, third)
            motor_functions(c.pull, c.drag, c.emf, c.loss, h, last)
            for p in range(2):
                for q in range(2):
                    size = h if q == 0 else h * c.supply  # of an acceleration, of a voltage
                    first, slope = size / 3 * third[1, p, q], size / 9 * third[2, p, q]
                    table.third[i, j, p, q] = third[0, p, q]
                    table.w11[i, j, p, q] = 1.5 * first - 1.5 * slope
                    table.w12[i, j, p, q] = 1.5 * slope - 0.5 * first
                    first, slope = size * last[1, p, q], size * last[2, p, q]
                    table.whole[i, j, p, q] = last[0, p, q]
                    table.w21[i, j, p, q] = 1.5 * first - 1.5 * slope
                    table.w22[i, j, p, q] = 1.5 * slope - 0.5 * first
    return table


@njit(nogil=True)
def _at(y, h, first, k1, second, k2, omega, current):  # pragma: no cover - compiled
    """The state behind y by two weighted rates, speed and current as given."""
    f, s = h * first, h * second
    angle = y[0] + f * k1[0] + s * k2[0]
    if len(y) == 3:
        return angle, omega, current
    return (
        angle,
        omega,
        current,
        y[3] + f * k1[3] + s * k2[3],
        y[4] + f * k1[4] + s * k2[4],
        y[5] + f * k1[5] + s * k2[5],
        y[6] + f * k1[6] + s * k2[6],
    )


@njit(nogil=True)
def _added(y, t, v, z, d, c, terms):  # pragma: no cover - compiled
    """(rates, acceleration beside the ideal motor's, terminal voltage); writes effects' rates."""
    s, o = _direction(y)
    torque, u = evaluate(terms, t, y, v, z, d)
    k = _rates(y, s, o, torque, u, c)
    return k, k[1] - (c.pull * y[2] - c.drag * y[1]), u


@njit(nogil=True)
def _slopes(y, t, v, z, d, c, terms, scale, g):  # pragma: no cover - compiled
    """Write into g (2, 2) how acceleration and voltage change with speed and current."""
    torque, u = evaluate(terms, t, y, v, z, d)
    for j in range(2):
        step = DIFFERENCE * scale[j]
        omega, current = y[1], y[2]
        if j == 0:
            omega += step
        else:
            current += step
        moved = _at(y, 0.0, 0.0, y, 0.0, y, omega, current)
        torque_there, u_there = evaluate(terms, t, moved, v, z, d)
        g[0, j] = c.ease * (torque_there - torque) / step
        g[1, j] = (u_there - u) / step


@njit(nogil=True)
def _factor(m, order):  # pragma: no cover - compiled
    """Replace m (4, 4) by its triangular factors, with pivots; `order` (4,) takes the rows'."""
    for i in range(4):
        best = i
        for j in range(i + 1, 4):
            if abs(m[j, i]) > abs(m[best, i]):
                best = j
        order[i] = best
        if best != i:
            for k in range(4):
                m[i, k], m[best, k] = m[best, k], m[i, k]
        for j in range(i + 1, 4):
            m[j, i] /= m[i, i]
            for k in range(i + 1, 4):
                m[j, k] -= m[j, i] * m[i, k]


@njit(nogil=True)
def _solve(m, order, r):  # pragma: no cover - compiled
    """Solve m r' = r, of `_factor`, into r."""
    for i in range(4):
        r[i], r[order[i]] = r[order[i]], r[i]
    for i in range(1, 4):
        for k in range(i):
            r[i] -= m[i, k] * r[k]
    for i in range(3, -1, -1):
        for k in range(i + 1, 4):
            r[i] -= m[i, k] * r[k]
        r[i] /= m[i, i]


@njit(nogil=True)
def collocate(
    edges,
    volts,
    steps,
    kind,
    table,
    samples,
    first,
    own,
    c,
    states,
    seen,
    gain,
    terms,
    scale,
    bend,
):  # pragma: no cover - compiled
    """Fill `states` as `integrate.runge_kutta` does; the same arguments, and these.

    Returns (the first sample that is not finite or -1, rounds of Newton's method).

    Args:
        kind: (K,) place of each interval's step length in `table`.
        table: `Moves`; its halvings bound the time.
        scale: speed [rad/s] and current [A] that the voltage amounts to; what is reached counts
            if it is more, since a voltage of 0 says nothing of what a load does.
        bend: by which part of the speed N may move it in a step, beside the straight line.
    """
    y, z = first, own
    (top, most), rounds = scale, 0
    if seen.size > 0:
        y = _corrected(y, gain * (seen[0] - y[1]))
    count = z.size
    z1, z2, d0, d1, d2 = z.copy(), z.copy(), z.copy(), z.copy(), z.copy()
    g1, g2 = np.zeros((2, 2)), np.zeros((2, 2))
    m, r, x = np.zeros((4, 4)), np.zeros(4), np.zeros(4)
    x0, dx = np.zeros(4), np.zeros(4)
    solved_at = SOLVED * bend
    largest = np.abs(z)
    halvings = table.third.shape[1] - 1
    units = 1 << halvings
    known, factored = False, -1
    order = np.zeros(4, np.int64)
    for k in range(volts.size):
        v = volts[k]
        length = (edges[k + 1] - edges[k]) / steps[k]
        level, at, done = 0, 0, 0
        while done < steps[k]:
            part = units >> level
            h = length / (1 << level)
            t = edges[k] + (done + at / units) * length
            i = kind[k]
            move = i * (halvings + 1) + level  # whose moves the matrix was factored with
            third, whole = table.third[i, level], table.whole[i, level]
            w11, w12 = table.w11[i, level], table.w12[i, level]
            w21, w22 = table.w21[i, level], table.w22[i, level]
            k1, a1, u1 = _added(y, t, v, z, d0, c, terms)
            k2, a2, u2 = k1, a1, u1
            a0, u0 = a1, u1
            for j in range(count):
                d1[j] = d2[j] = d0[j]
            for j in range(2):
                x[j] = third[j, 0] * y[1] + third[j, 1] * y[2]
                x[j] += (w11[j, 0] + w12[j, 0]) * a1 + (w11[j, 1] + w12[j, 1]) * u1
                x[2 + j] = whole[j, 0] * y[1] + whole[j, 1] * y[2]
                x[2 + j] += (w21[j, 0] + w22[j, 0]) * a1 + (w21[j, 1] + w22[j, 1]) * u1
            last, solved, miss, share = np.inf, False, np.inf, 1.0
            y1 = y2 = y
            for turn in range(MOST_ROUNDS):
                rounds += 1
                y1 = _at(y, h, 5 / 12, k1, -1 / 12, k2, x[0], x[1])
                y2 = _at(y, h, 3 / 4, k1, 1 / 4, k2, x[2], x[3])
                stayed = len(y) == 3
                for j in range(count):
                    last_z = z2[j]
                    z1[j] = z[j] + h * (5 / 12 * d1[j] - 1 / 12 * d2[j])
                    z2[j] = z[j] + h * (3 / 4 * d1[j] + 1 / 4 * d2[j])
                    largest[j] = max(largest[j], abs(z2[j]))
                    stayed = stayed and abs(z2[j] - last_z) <= STAYED * largest[j]
                k1, a1, u1 = _added(y1, t + h / 3, v, z1, d1, c, terms)
                k2, a2, u2 = _added(y2, t + h, v, z2, d2, c, terms)
                for j in range(2):
                    r[j] = third[j, 0] * y[1] + third[j, 1] * y[2] - x[j]
                    r[j] += w11[j, 0] * a1 + w11[j, 1] * u1 + w12[j, 0] * a2 + w12[j, 1] * u2
                    r[2 + j] = whole[j, 0] * y[1] + whole[j, 1] * y[2] - x[2 + j]
                    r[2 + j] += w21[j, 0] * a1 + w21[j, 1] * u1 + w22[j, 0] * a2 + w22[j, 1] * u2
                fast, much = max(top, abs(x[2])), max(most, abs(x[3]))
                off = max(max(abs(r[0]), abs(r[2])) / fast, max(abs(r[1]), abs(r[3])) / much)
                if terms is not None and off > solved_at and not off < miss and share > LEAST_SHARE:
                    # Beyond a bend of a term Newton's step leads too far: take less of it.
                    share, known = 0.5 * share, False
                    for j in range(4):
                        x[j] = x0[j] + share * dx[j]
                    continue
                miss, share = off, 1.0
                if terms is not None:
                    if not known:
                        _slopes(y1, t + h / 3, v, z1, d0, c, terms, (fast, much), g1)
                        _slopes(y2, t + h, v, z2, d0, c, terms, (fast, much), g2)
                        known, factored = True, -1
                    if factored != move:
                        for p in range(2):
                            for q in range(2):
                                one = 1.0 if p == q else 0.0
                                m[p, q] = one - w11[p, 0] * g1[0, q] - w11[p, 1] * g1[1, q]
                                m[p, 2 + q] = -w12[p, 0] * g2[0, q] - w12[p, 1] * g2[1, q]
                                m[2 + p, q] = -w21[p, 0] * g1[0, q] - w21[p, 1] * g1[1, q]
                                m[2 + p, 2 + q] = one - w22[p, 0] * g2[0, q] - w22[p, 1] * g2[1, q]
                        _factor(m, order)
                        factored = move
                    _solve(m, order, r)
                for j in range(4):
                    x0[j], dx[j] = x[j], r[j]
                    x[j] += r[j]
                change = max(max(abs(r[0]), abs(r[2])) / fast, max(abs(r[1]), abs(r[3])) / much)
                if not change < np.inf:
                    break
                if change <= solved_at and (stayed or turn + 1 >= ROUNDS_TO_STAY):
                    solved = True
                    break
                if change > SLOW * last:
                    known = False
                last = change
            known = known and solved
            aside = abs(w21[0, 0] * (1.5 * a1 - 0.5 * a2 - a0))
            aside += abs(w21[0, 1] * (1.5 * u1 - 0.5 * u2 - u0))
            reached = max(top, abs(x[2]))
            if level < halvings and not (solved and aside <= bend * reached):
                level = min(level + CUTS, halvings)
                continue
            y = _at(y, h, 3 / 4, k1, 1 / 4, k2, x[2], x[3])
            top, most = reached, max(most, abs(x[3]))
            for j in range(count):
                z[j] += h * (3 / 4 * d1[j] + 1 / 4 * d2[j])
            at += part
            if at == units:
                at, done = 0, done + 1
            if level > 0 and aside <= EASE * bend * reached and at % (units >> (level - 1)) == 0:
                level -= 1
        sample = samples[k + 1]
        if sample >= 0:
            for i in range(len(y)):
                states[sample, i] = y[i]
            for i in range(count):
                states[sample, STATES + i] = z[i]
            if not _is_finite(y, z):
                return sample, rounds
            if seen.size > 0:
                y = _corrected(y, gain * (seen[sample] - y[1]))
    return -1, rounds
