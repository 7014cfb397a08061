"""Greedy addition by held-out error, the usual way to extend a model by hand."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ldt_core.diagnosis.closing import free_run

if TYPE_CHECKING:
    from ldt_core.challenge.comparators.run import Data, Found

MOST = 3  # effects
TRIED = 8  # effects that are tried beside those chosen, the most promising
BLOCKS = 5  # of an experiment, among which the improvement's scatter is judged


def greedy(data: Data) -> Found:
    """Add the effect that lowers the held-out error most, then the next beside it, and so on.

    An effect is added if it improves on the set before it by more than one standard error over
    blocks of the held-out experiments (the one-standard-error rule: Breiman and others,
    Classification and Regression Trees, 1984).
    """
    chosen: list = []
    error, tried = _blocks(data, []), data.fits.alone
    for size in range(1, MOST + 1):
        ranked = [(_blocks(data, f.use), f) for f in tried]
        if not ranked:
            break
        best, fitted = min(ranked, key=lambda q: float(q[0].sum()))
        gain = error - best
        if not gain.mean() > gain.std(ddof=1) / math.sqrt(gain.size):
            break
        chosen, error = fitted.use, best
        if size < MOST:
            tried = data.fits.grown(fitted, TRIED)
    return data.with_effects(chosen)


def _blocks(data: Data, use: list) -> NDArray[np.float64]:
    """Sum of squared errors of each block of the held-out experiments."""
    found = []
    for e in data.held:
        square = (e.speed - free_run(data.machine, e, use)) ** 2
        square = np.where(np.isfinite(square), square, 1e12)
        found += [float(part.sum()) for part in np.array_split(square, BLOCKS)]
    return np.array(found)
