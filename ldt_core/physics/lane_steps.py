"""Runge-Kutta steps of eight free runs at once, each lane by the arithmetic of `integrate.py`."""

from __future__ import annotations

import math

from ldt_core.base.compiled import njit
from ldt_core.physics.integrate import (
    RIGID_STATES,
    SMALL_TURN,
    _moved,
    _rates,
    _summed,
)
from ldt_core.physics.lane_terms import evaluate_lanes
from ldt_core.physics.lanes import (
    LARGEST_ANGLE,
    WIDTH,
    any_less,
    lane,
    lanes_of,
    load,
    sine_and_cosine,
    store,
    with_lane,
)


@njit(nogil=True)
def direction(y):  # pragma: no cover - compiled
    """Sine and cosine of the angle, which three states do not need."""
    if len(y) == RIGID_STATES:
        return lanes_of(0.0), lanes_of(1.0)
    s, o = sine_and_cosine(y[0])
    if any_less(LARGEST_ANGLE, abs(y[0])):
        for i in range(WIDTH):
            angle = lane(y[0], i)
            if abs(angle) > LARGEST_ANGLE:
                s, o = with_lane(s, i, math.sin(angle)), with_lane(o, i, math.cos(angle))
    return s, o


@njit(nogil=True)
def turned(y, s, o, delta):  # pragma: no cover - compiled
    """As `integrate.turned`."""
    if len(y) == RIGID_STATES:
        return s, o
    q = delta * delta
    a = 1 - q * (1 / 20) * (1 - q * (1 / 42) * (1 - q * (1 / 72)))
    a = delta - delta * q * (1 / 6) * a
    b = 1 - q * (1 / 30) * (1 - q * (1 / 56) * (1 - q * (1 / 90)))
    b = 1 - q * 0.5 * (1 - q * (1 / 12) * b)
    s, o = s * b + o * a, o * b - s * a
    if any_less(SMALL_TURN, abs(delta)):
        for i in range(WIDTH):
            if abs(lane(delta, i)) > SMALL_TURN:
                angle = lane(y[0], i) + lane(delta, i)
                s, o = with_lane(s, i, math.sin(angle)), with_lane(o, i, math.cos(angle))
    return s, o


@njit(nogil=True)
def interval(y, begin, length, count, v, c, terms, z):  # pragma: no cover - compiled
    """The state behind an interval of constant voltage; z[0] (own, WIDTH) moves along.

    z[1] to z[5] are room for the stages.
    """
    h = length / count
    half, sixth = h / 2, h / 6
    own = z.shape[1]
    z0, moved, d1, d2, d3, d4 = z[0], z[1], z[2], z[3], z[4], z[5]
    s, o = direction(y)
    for step in range(count):
        t = begin + step * h
        torque, u = evaluate_lanes(terms, t, y, v, z0, d1)
        k1 = _rates(y, s, o, torque, u, c)
        w = _moved(y, half, k1)
        s2, o2 = turned(y, s, o, half * k1[0])
        for i in range(own):
            store(moved, i, load(z0, i) + half * load(d1, i))
        torque, u = evaluate_lanes(terms, t + half, w, v, moved, d2)
        k2 = _rates(w, s2, o2, torque, u, c)
        w = _moved(y, half, k2)
        s3, o3 = turned(y, s, o, half * k2[0])
        for i in range(own):
            store(moved, i, load(z0, i) + half * load(d2, i))
        torque, u = evaluate_lanes(terms, t + half, w, v, moved, d3)
        k3 = _rates(w, s3, o3, torque, u, c)
        w = _moved(y, h, k3)
        s4, o4 = turned(y, s, o, h * k3[0])
        for i in range(own):
            store(moved, i, load(z0, i) + h * load(d3, i))
        torque, u = evaluate_lanes(terms, t + h, w, v, moved, d4)
        k4 = _rates(w, s4, o4, torque, u, c)
        total = _summed(k1, k2, k3, k4)
        s, o = turned(y, s, o, sixth * total[0])
        y = _moved(y, sixth, total)
        for i in range(own):
            rise = load(d1, i) + 2 * (load(d2, i) + load(d3, i)) + load(d4, i)
            store(z0, i, load(z0, i) + sixth * rise)
    return y
