"""How many states the data can show: the smallest order that is not worse on held-out samples.

Every experiment is cut into blocks of equal length. One fold leaves out every third block, fits the
rest, and scores the free run, which goes through the gaps since it needs the voltage alone. The
first block of an experiment is never left out: it fixes the start state.

A fold begins at the minimum of all samples, of which it lacks a third, so one step of Gauss and
Newton leads to its own; where that step does not lower the error, the data do not determine the
order, and the fold stays where it begins.

Parsimony: with mean square errors per block, the smallest order wins whose mean excess over the
best order is within two standard errors of that excess, and whose root mean square error is at most
1.2 times the best. The excess is paired by block, so that blocks that are hard for every order do
not count. The second condition is for data with a single transient: its block alone makes the
standard error large. Whole blocks are left out and compared, not samples, since neighbouring
residuals depend on each other.

Orders are tried upwards, until the two last ones have not paid: a pair of complex poles may need
both of its states to show.

Reference: L. Breiman et al., "Classification and Regression Trees" (1984), whose rule has one
standard error; by chance alone that takes a larger order in one comparison of six, two in one of
forty.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ldt_core.estimation.linear.output_error import OutputError

Array = NDArray[np.float64]

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
ROUNDING = 1e-7
#: Orders above the present choice that are tried before the search for an order ends.
ORDERS_WITHOUT_GAIN = 2


def scores(search: OutputError, theta: Array) -> Array:
    """(blocks left out in any fold, of all experiments,) mean square errors of that order.

    Args:
        search: over all samples; one experiment at least has `LEAST_LENGTH` of them.
        theta: the minimum of the order on all samples.
    """
    blocks = search.cut(BLOCKS)
    sizes = np.diff(blocks.cuts)
    block = np.arange(sizes.size) % BLOCKS - 1
    short = np.repeat(np.array(search.lengths) < LEAST_LENGTH, BLOCKS)
    parts = [(block < 0) | (block % FOLDS != fold) | short for fold in range(FOLDS)]
    left_out = blocks.refitted(theta, parts)
    each = zip(left_out, parts, strict=True)
    return np.concatenate([squares[~kept] / sizes[~kept] for squares, kept in each])


def choose(found: Mapping[int, Array]) -> int:
    """The order.

    Args:
        found: order → its `scores` (blocks,), errors in deviations of the output.
    """
    means = {n: float(s.mean()) for n, s in found.items()}
    best = min(means, key=lambda n: (means[n], n))
    for n in sorted(found):
        excess = found[n] - found[best]
        error = excess.std(ddof=1) / np.sqrt(excess.size)
        chance = excess.mean() <= STANDARD_ERRORS * error
        if means[n] < ROUNDING**2 or (chance and means[n] <= MOST_EXCESS**2 * means[best]):
            break
    return n
