"""Eight free runs at once, from sample to sample.

The runs share sample times, steps and terms; machine, voltage, start and values are each lane's
own. Each does what it would do alone: what a lane's neighbours need is computed and left aside.
"""

from __future__ import annotations

import math

import numpy as np

from ldt_core.base.compiled import njit
from ldt_core.physics.exponential_steps import exponential_interval
from ldt_core.physics.integrate import LONGEST_PAUSE, RIGID_STATES, STATES, _corrected
from ldt_core.physics.lane_steps import interval
from ldt_core.physics.lane_terms import forget_lanes, is_quiet_lane
from ldt_core.physics.lanes import (
    WIDTH,
    any_less,
    lane,
    lanes_of,
    load,
    store,
    where_less,
    with_lane,
)
from ldt_core.physics.run_plan import Coefficients

# Steps of an interval: which of `exponential_moves`. Of int64, since numba compiles what takes a
# literal once for each: half a second more.
SHORT, LONG = np.int64(0), np.int64(1)


@njit(nogil=True)
def _moved(y, begin, length, count, v, c, terms, moves, which, z):  # pragma: no cover - compiled
    """The state behind an interval of constant voltage; z[0] moves along."""
    if moves is None:
        return interval(y, begin, length, count, v, c, terms, z)
    return exponential_interval(y, begin, length, count, v, c, terms, moves, which, z)


@njit(nogil=True)
def _loaded(a, like):  # pragma: no cover - compiled
    x, y, z = load(a, 0), load(a, 1), load(a, 2)
    if len(like) == RIGID_STATES:
        return x, y, z
    return x, y, z, load(a, 3), load(a, 4), load(a, 5), load(a, 6)


@njit(nogil=True)
def _total(y, z):  # pragma: no cover - compiled
    total = y[0] + y[1] + y[2]
    if len(y) != RIGID_STATES:
        total = total + y[3] + y[4] + y[5] + y[6]
    for i in range(z.shape[1]):
        total = total + load(z[0], i)
    return total


@njit(nogil=True)
def _chosen(mask, a, b):  # pragma: no cover - compiled
    """The states of a where the mask is 1, of b where it is 0."""
    x = where_less(0.5, mask, a[0], b[0])
    y = where_less(0.5, mask, a[1], b[1])
    z = where_less(0.5, mask, a[2], b[2])
    if len(a) == RIGID_STATES:
        return x, y, z
    return (
        x,
        y,
        z,
        where_less(0.5, mask, a[3], b[3]),
        where_less(0.5, mask, a[4], b[4]),
        where_less(0.5, mask, a[5], b[5]),
        where_less(0.5, mask, a[6], b[6]),
    )


@njit(nogil=True)
def _tried(y, begin, length, steps, long, v, c, terms, moves, z, wait, pause):  # pragma: no cover
    """As `_moved`, where some lanes may take `long` steps: see `integrate.runge_kutta`."""
    own = z.shape[1]
    kept, reached = z[6], z[7]
    for i in range(own):
        store(kept, i, load(z[0], i))
    short, some = lanes_of(1.0), False
    after = y
    for i in range(WIDTH):
        some = some or wait[i] == 0
    if some:
        forget_lanes(terms)
        after = _moved(y, begin, length, long, v, c, terms, moves, LONG, z)
        total = _total(after, z)
        for i in range(WIDTH):
            if wait[i] == 0:
                if is_quiet_lane(terms, i) and math.isfinite(lane(total, i)):
                    short = with_lane(short, i, 0.0)
                    pause[i] = 1
                else:
                    wait[i], pause[i] = pause[i], min(2 * pause[i], LONGEST_PAUSE)
    if any_less(0.5, short):
        for i in range(own):
            store(reached, i, load(z[0], i))
            store(z[0], i, load(kept, i))
        exact = _moved(y, begin, length, steps, v, c, terms, moves, SHORT, z)
        after = _chosen(short, exact, after)
        for i in range(own):
            store(z[0], i, where_less(0.5, short, load(z[0], i), load(reached, i)))
    return after


@njit(nogil=True)
def run_lanes(
    times, volts, steps, long, first, like, c, states, z, seen, gain, terms, moves, failed
):  # pragma: no cover - compiled
    """Fill `states` (L, 7 + own, WIDTH), and `failed` (WIDTH,) from -1.

    Args:
        times: (L,) sample times [s].
        volts: (L, WIDTH) voltage from each sample to the next [V].
        steps, long: (L - 1,) steps in each interval, fewer to try first.
        first: (7, WIDTH) the machine's state at the first sample.
        like: a tuple as long as the state, three or seven numbers.
        c: (13, WIDTH), `Coefficients` in their order.
        states: first row given.
        z: (8, own, WIDTH) the effects' states in the first row, and room.
        seen, gain: (L, WIDTH) speeds to follow [rad/s] or empty, the part taken at a sample.
        terms: `LaneTerms`, or None.
        moves: of `exponential_moves` for one of `steps` and one of `long`, which are then the same
            in all intervals; or None, and all is stepped over.
        failed: takes the first sample at which each lane is not finite.
    """
    coefficients = Coefficients(
        load(c, 0),
        load(c, 1),
        load(c, 2),
        load(c, 3),
        load(c, 4),
        load(c, 5),
        load(c, 6),
        load(c, 7),
        load(c, 8),
        load(c, 9),
        load(c, 10),
        load(c, 11),
        load(c, 12),
    )
    y = _loaded(first, like)
    if seen.size > 0:
        y = _corrected(y, gain * (load(seen, 0) - y[1]))
    wait, pause = np.zeros(WIDTH, np.int64), np.ones(WIDTH, np.int64)
    width = states.shape[1]
    own = z.shape[1]
    for k in range(times.size - 1):
        v, begin, length = load(volts, k), times[k], times[k + 1] - times[k]
        if terms is not None and long[k] < steps[k]:
            y = _tried(
                y, begin, length, steps[k], long[k], v, coefficients, terms, moves, z, wait, pause
            )
        else:
            y = _moved(y, begin, length, steps[k], v, coefficients, terms, moves, SHORT, z)
        for i in range(WIDTH):
            wait[i] = max(wait[i] - 1, 0)
        at = (k + 1) * width
        for i in range(len(y)):
            store(states, at + i, y[i])
        for i in range(own):
            store(states, at + STATES + i, load(z[0], i))
        total = _total(y, z)
        left = 0
        for i in range(WIDTH):
            if failed[i] < 0 and not math.isfinite(lane(total, i)):
                failed[i] = k + 1
            left += failed[i] < 0
        if left == 0:
            return
        if seen.size > 0:
            y = _corrected(y, gain * (load(seen, k + 1) - y[1]))
