"""How many states the data can show: the smallest order that is not worse on held-out samples.

Every experiment is cut into blocks of equal length. One fold leaves out every third block, fits the
rest, and scores the free run, which goes through the gaps since it needs the voltage alone. The
first block of an experiment is never left out: it fixes the start state.

Parsimony: with mean square errors per block, the smallest order wins whose mean excess over the
best order is within two standard errors of that excess, and whose root mean square error is at most
1.2 times the best. The excess is paired by block, so that blocks that are hard for every order do
not count. The second condition is for data with a single transient: its block alone makes the
standard error large. Whole blocks are left out and compared, not samples, since neighbouring
residuals depend on each other.

Reference: L. Breiman et al., "Classification and Regression Trees" (1984), whose rule has one
standard error; by chance alone that takes a larger order in one comparison of six, two in one of
forty.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ldt_core.identification.output_error import OutputError

Array = NDArray[np.float64]

FOLDS = 3
BLOCKS = 31  # the first one stays, the others are shared out evenly among the folds
#: A shorter experiment is fitted whole: what is left of it would not fix its start state.
LEAST_LENGTH = 2 * BLOCKS
STANDARD_ERRORS = 2.0  # see above, as the next
MOST_EXCESS = 1.2
#: Outputs are scaled to deviation 1; errors below this are rounding, and no evidence for an order.
ROUNDING = 1e-7
#: A fold begins at the minimum of all samples and needs few steps; one that creeps shows an order
#: that the data do not determine.
REFIT_STEPS = 5


def choose(search: OutputError, fits: Mapping[int, Array]) -> tuple[int, dict[int, float]]:
    """(order, held-out root mean square error of each order, in deviations of the output).

    Args:
        search: over all samples; one experiment at least has `LEAST_LENGTH` of them.
        fits: order → θ, the minimum of each on all samples, where the folds' searches begin.
    """
    scores = {n: _held_out(search, theta) for n, theta in fits.items()}
    means = {n: float(s.mean()) for n, s in scores.items()}
    best = min(means, key=lambda n: (means[n], n))
    for n in sorted(scores):
        excess = scores[n] - scores[best]
        error = excess.std(ddof=1) / np.sqrt(excess.size)
        chance = excess.mean() <= STANDARD_ERRORS * error
        if means[n] < ROUNDING**2 or (chance and means[n] <= MOST_EXCESS**2 * means[best]):
            break
    return n, {k: float(np.sqrt(m)) for k, m in means.items()}


def _held_out(search: OutputError, theta: Array) -> Array:
    """(blocks left out in any fold, of all experiments,) mean square errors."""
    scores = []
    for fold in range(FOLDS):
        part = search.refit({n: _kept(n, fold) for n in set(search.lengths)})
        found, _ = part.minimise(theta, REFIT_STEPS)
        error = (search.y - search.outputs(found, part.solve(found))) ** 2
        for begin, length in zip(search.begins, search.lengths, strict=False):
            blocks, own = _blocks(length), error[begin : begin + length]
            left_out = range(fold, BLOCKS - 1, FOLDS)
            scores += [own[blocks == b].mean() for b in left_out if length >= LEAST_LENGTH]
    return np.array(scores)


def _kept(length: int, fold: int) -> NDArray[np.bool_]:
    """(length,) whether a sample is fitted in that fold."""
    blocks = _blocks(length)
    return (blocks < 0) | (blocks % FOLDS != fold) | (length < LEAST_LENGTH)


def _blocks(length: int) -> NDArray[np.int64]:
    """(length,) number of each sample's block, −1 for the first block."""
    return np.arange(length) * BLOCKS // length - 1
