"""The best minimum of each order, and the smallest order that is not worse on held-out samples.

Start values are the poles of subspace identification (PO-MOESP) at several time scales, and the
order below with one more real pole. Past inputs and outputs serve as instruments, so that noise
does not bias the poles, and a constant is projected out with the future input, so that an offset
does not become a pole at 0. A rate far above the dynamics squeezes all discrete poles to 1, so the
data are averaged over blocks of 1, 4, 16 … samples as well. The best starts run a few steps each
and the winner runs on. A pole that is a drift rather than a decay must be worth it.

To choose the order, every experiment is cut into blocks. One fold leaves out every third block,
fits the rest by one Gauss-Newton step from the minimum of all samples, and scores the free run. The
first block of an experiment is never left out: it fixes the start state. The smallest order wins
whose mean excess over the best order, paired by block, is within two standard errors, and whose
root mean square error is at most 1.2 times the best. The second condition is for data with a single
transient: its block alone makes the standard error large. Orders are tried upwards, until the two
last ones have not paid: a pair of complex poles may need both of its states to show.

References: M. Verhaegen, "Subspace model identification, part 3", Int. J. Control 61 (1995)
555–586; L. Breiman et al., "Classification and Regression Trees" (1984), whose rule has one
standard error: by chance alone that takes a larger order in one comparison of six, two in one of
forty.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.estimation.linear import schwarz
from ldt_core.estimation.linear.output_error import COST_TOLERANCE, MOST_STEPS, OutputError

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

#: Samples averaged at one time scale relative to the scale before.
BLOCK_RATIO = 4
#: Columns of the data matrices, at most: more tell a start nothing more, but cost time.
MOST_COLUMNS = 1000
#: Rows per quarter beyond the order: a longer past helps against noise, at quadratic cost.
SPARE_ROWS = 5

#: Fits with held-out samples: each leaves out a third, the least that moves a fit enough to show.
FOLDS = 3
#: Blocks of an experiment: the first stays, the others are shared out evenly among the folds.
BLOCKS = 31
#: [samples] A shorter experiment is fitted whole: the rest of it would not fix its start state.
LEAST_LENGTH = 2 * BLOCKS
#: Standard errors of the mean excess over the best order that chance explains; see above.
STANDARD_ERRORS = 2.0
#: Root mean square error relative to the best order's, at most; see above.
MOST_EXCESS = 1.2
#: [output deviations] Errors below this are rounding, and no evidence for an order.
LEAST_ERROR = 1e-7
#: Orders above the present choice that are tried before the search for an order ends.
ORDERS_WITHOUT_GAIN = 2


def best_of_orders(
    search: OutputError, orders: range, choosing: bool
) -> tuple[Array, dict[int, float]]:
    """θ of the last order or of the one chosen, and held-out error of each order tried.

    Args:
        search: the data.
        orders: upwards from 1.
        choosing: whether the order is to be chosen among them, or the last is wanted.
    """
    scored = choosing and len(orders) > 1 and search.longest >= LEAST_LENGTH
    fits: dict[int, Array] = {}
    errors: dict[int, Array] = {}
    chosen = orders[0] if choosing else orders[-1]
    for n, theta in _minima(search, orders if scored or not choosing else orders[:1], choosing):
        fits[n] = theta
        if scored:
            errors[n] = _block_errors(search, theta)
            chosen = _choose(errors)
            if n - chosen >= ORDERS_WITHOUT_GAIN:
                break
    return fits[chosen], {n: float(np.sqrt(s.mean())) for n, s in errors.items()}


def _minima(search: OutputError, orders: range, choosing: bool) -> Iterator[tuple[int, Array]]:
    """(order, θ of the best minimum found), roughly each if choosing, else the last to the end."""
    candidates = _starts(*search.pieces, orders, search.sigma)
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


def _starts(
    inputs: list[Array], outputs: list[Array], orders: range, sigma: float
) -> dict[int, list[Array]]:
    """Start values θ for each order, one for each time scale that the data allow."""
    found: dict[int, list[Array]] = {n: [] for n in orders}
    rows = orders[-1] + SPARE_ROWS
    width = 1
    while True:
        hankels = _hankels(inputs, outputs, width, rows)
        if hankels is None:
            return found
        observability = _observability(hankels, rows)
        for n in orders:
            shifted = np.linalg.lstsq(observability[:-1, :n], observability[1:, :n], rcond=None)[0]
            poles = _continuous(np.linalg.eigvals(shifted)) / width
            found[n].append(schwarz.from_poles(poles, sigma))
        width *= BLOCK_RATIO


def _hankels(inputs: list[Array], outputs: list[Array], width: int, rows: int) -> Array | None:
    """(1 + 4 rows, columns): constant, future input, past input, past output, future output."""
    blocks = []
    total = sum(max(0, u.size // width - 2 * rows + 1) for u in inputs)
    if total < 6 * rows:
        return None
    stride = -(-total // MOST_COLUMNS)
    for u, y in zip(inputs, outputs, strict=True):
        size = u.size // width
        if size < 2 * rows:
            continue
        means = [s[: size * width].reshape(size, width).mean(axis=1) for s in (u, y)]
        windows = [np.lib.stride_tricks.sliding_window_view(m, 2 * rows)[::stride] for m in means]
        (past_u, future_u), (past_y, future_y) = (np.hsplit(w, 2) for w in windows)
        one = np.ones((len(past_u), 1))
        blocks.append(np.hstack([one, future_u, past_u, past_y, future_y]))
    return np.vstack(blocks)


def _observability(hankels: Array, rows: int) -> Array:
    """(rows, rows): orthonormal directions of the future output's states, strongest first."""
    factor = np.asarray(np.linalg.qr(hankels, mode="r")).T
    middle = slice(1 + rows, 1 + 3 * rows)
    return np.linalg.svd(factor[1 + 3 * rows :, middle])[0]


def _continuous(poles: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Logarithms; real poles that no held continuous system has (0 and below) become fast ones."""
    poles = poles.astype(np.complex128)
    least = np.exp(-schwarz.FASTEST_DECAY)
    impossible = (np.abs(poles.imag) < 1e-12) & (poles.real < least)
    return np.log(np.where(impossible, np.maximum(np.abs(poles), least), poles))


def _block_errors(search: OutputError, theta: Array) -> Array:
    """(blocks left out in any fold, of all experiments,) mean square errors at θ."""
    blocks = search.cut(BLOCKS)
    sizes = np.diff(blocks.cuts)
    block = np.arange(sizes.size) % BLOCKS - 1
    short = np.repeat(np.array(search.lengths) < LEAST_LENGTH, BLOCKS)
    parts = [(block < 0) | (block % FOLDS != fold) | short for fold in range(FOLDS)]
    left_out = blocks.refitted(theta, parts)
    each = zip(left_out, parts, strict=True)
    return np.concatenate([squares[~kept] / sizes[~kept] for squares, kept in each])


def _choose(found: Mapping[int, Array]) -> int:
    """The order; `found` has the `_block_errors` of each, in deviations of the output."""
    means = {n: float(s.mean()) for n, s in found.items()}
    best = min(means, key=lambda n: (means[n], n))
    for n in sorted(found):
        excess = found[n] - found[best]
        error = excess.std(ddof=1) / np.sqrt(excess.size)
        chance = excess.mean() <= STANDARD_ERRORS * error
        if means[n] < LEAST_ERROR**2 or (chance and means[n] <= MOST_EXCESS**2 * means[best]):
            break
    return n
