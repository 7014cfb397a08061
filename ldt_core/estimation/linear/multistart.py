"""The best minimum of each order, from several starts.

Start values are the poles of subspace identification at several time scales (`subspace`), and the
order below with one more real pole, fast, middling or slow. The best of them run a few steps each
and the winner runs on; an order that only serves as a start for the next one stops there. A pole
that is a drift rather than a decay must be worth it, or gives way to the best minimum without one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ldt_core.estimation.linear import schwarz, subspace
from ldt_core.estimation.linear.output_error import COST_TOLERANCE, MOST_STEPS, OutputError

Array = NDArray[np.float64]

#: Start values that are followed, for an order that is wanted; for one on the way, the best alone.
STARTS_FOLLOWED = 2
#: Steps in which the best of them shows: the first steps gain most.
RACE_STEPS = 4
#: [per sample] Where a fast pole begins, e^−1 within a sample.
ADDED_FAST_POLE = 1.0
#: Factor of the mean square error by which a slower pole than the data can show must lower it:
#: friction and load make drifts worth a tenth, a truly slow machine one worth far more.
DRIFT_GAIN = 1.5
#: Steps while an order is yet to be chosen, which needs no exact minimum.
ROUGH_STEPS = 10
#: Relative gain that ends such a search.
ROUGH_TOLERANCE = 1e-5
#: [per experiment] Real poles that are added to those of the order below.
ADDED_POLES = (3.0, 30.0, 300.0)


def minima(search: OutputError, orders: range, choosing: bool) -> Iterator[tuple[int, Array]]:
    """(order, θ of the best minimum found), one after the other.

    Args:
        search: the data.
        orders: upwards from 1.
        choosing: whether each order is wanted, roughly, or the last alone, to the end.
    """
    candidates = subspace.starts(*search.pieces, orders, search.sigma)
    theta = np.zeros(0)
    for n in orders:
        before = schwarz.poles_of(theta, search.sigma) if n > 1 else np.zeros(0)
        wanted = choosing or n == orders[-1]
        tried = list(candidates[n])
        if wanted or not tried:
            added = [np.append(before, -p / search.longest) for p in ADDED_POLES]
            tried += [schwarz.from_poles(poles, search.sigma) for poles in added]
        theta = _race(search, tried, STARTS_FOLLOWED if wanted else 1)
        if wanted:
            steps, tolerance = (
                (ROUGH_STEPS, ROUGH_TOLERANCE) if choosing else (MOST_STEPS, COST_TOLERANCE)
            )
            theta = search.minimise(theta, steps, tolerance)[0]
        if n > 1 and schwarz.drifts(theta, search.sigma):
            fast = schwarz.from_poles(np.append(before, -ADDED_FAST_POLE), search.sigma)
            theta = _settled(search, theta, [fast, *candidates[n]])
        yield n, theta


def _race(search: OutputError, tried: list[Array], runners: int) -> Array:
    losses = [search.loss(theta) for theta in tried]
    best = np.argsort(losses, kind="stable")[:runners]
    raced = [search.minimise(tried[i], RACE_STEPS, ROUGH_TOLERANCE) for i in best]
    return min(raced, key=lambda minimum: minimum[1])[0]


def _settled(search: OutputError, drifting: Array, tried: list[Array]) -> Array:
    """The best minimum without a drift, unless the drift is worth it."""
    minima = [search.minimise(theta, ROUGH_STEPS, ROUGH_TOLERANCE) for theta in tried]
    settled = [m for m in minima if not schwarz.drifts(m[0], search.sigma)]
    theta, loss = min(settled, key=lambda m: m[1], default=(drifting, np.inf))
    return theta if loss < DRIFT_GAIN * search.loss(drifting) else drifting
