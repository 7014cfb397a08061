"""Runge-Kutta steps of a machine that shakes no foundation: three states instead of seven."""

from __future__ import annotations

import math

from numba import njit

from ldt_core.physics.terms import evaluate, forget, is_quiet

PATIENCE = 16  # intervals with short steps, at most, before long ones are tried again


@njit(cache=True, nogil=True)
def run_rigid(
    edges, volts, steps, long, samples, start, c, states, seen, gain, terms
):  # pragma: no cover - compiled
    """As `integrate._run_with_terms`, without sines: angle, speed and current alone."""
    a, w, i = start[0], start[1], start[2]
    if seen.size > 0:
        w += gain * (seen[0] - w)
    z = start[7:].copy()
    moved = z.copy()
    d1, d2, d3, d4 = z.copy(), z.copy(), z.copy(), z.copy()
    before, kept = (a, w, i), z.copy()
    k, wait, pause, again = 0, 0, 1, False
    while k < volts.size:
        v = volts[k]
        trial = long[k] < steps[k] and wait == 0 and not again
        count = long[k] if trial else steps[k]
        if trial:
            before = a, w, i
            for j in range(z.size):
                kept[j] = z[j]
            forget(terms)
        h = (edges[k + 1] - edges[k]) / count
        half, sixth = h / 2, h / 6
        for step in range(count):
            t = edges[k] + step * h
            torque, u = evaluate(terms, t, (a, w, i), v, z, d1)
            w1 = c.pull * i - c.drag * w + c.ease * torque
            i1 = c.supply * u - c.loss * i - c.emf * w
            for j in range(z.size):
                moved[j] = z[j] + half * d1[j]
            wa, ia = w + half * w1, i + half * i1
            torque, u = evaluate(terms, t + half, (a + half * w, wa, ia), v, moved, d2)
            w2 = c.pull * ia - c.drag * wa + c.ease * torque
            i2 = c.supply * u - c.loss * ia - c.emf * wa
            for j in range(z.size):
                moved[j] = z[j] + half * d2[j]
            wb, ib = w + half * w2, i + half * i2
            torque, u = evaluate(terms, t + half, (a + half * wa, wb, ib), v, moved, d3)
            w3 = c.pull * ib - c.drag * wb + c.ease * torque
            i3 = c.supply * u - c.loss * ib - c.emf * wb
            for j in range(z.size):
                moved[j] = z[j] + h * d3[j]
            wc, ic = w + h * w3, i + h * i3
            torque, u = evaluate(terms, t + h, (a + h * wb, wc, ic), v, moved, d4)
            w4 = c.pull * ic - c.drag * wc + c.ease * torque
            i4 = c.supply * u - c.loss * ic - c.emf * wc
            a += sixth * (w + 2 * (wa + wb) + wc)
            w += sixth * (w1 + 2 * (w2 + w3) + w4)
            i += sixth * (i1 + 2 * (i2 + i3) + i4)
            for j in range(z.size):
                z[j] += sixth * (d1[j] + 2 * (d2[j] + d3[j]) + d4[j])
        if trial:
            again = not (is_quiet(terms) and math.isfinite(a + w + i + z.sum()))
            if again:
                a, w, i = before
                for j in range(z.size):
                    z[j] = kept[j]
                wait, pause = pause, min(2 * pause, PATIENCE)
                continue
            pause = 1
        again, wait, k = False, max(wait - 1, 0), k + 1
        at = samples[k]
        if at >= 0:
            states[at, 0], states[at, 1], states[at, 2] = a, w, i
            for j in range(z.size):
                states[at, 7 + j] = z[j]
            if not math.isfinite(a + w + i + z.sum()):
                return at
            if seen.size > 0:
                w += gain * (seen[at] - w)
    return -1
