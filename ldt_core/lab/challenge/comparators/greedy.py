"""Greedy addition by held-out error, the usual way to extend a model by hand."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from ldt_core.diagnosis.holdout import free_run
from ldt_core.lab.challenge.comparators.held_out import Array, block_errors, improves

if TYPE_CHECKING:
    from ldt_core.base.experiment import Experiment
    from ldt_core.lab.challenge.comparators.compare import Data, Found

MOST = 3  # effects
TRIED = 8  # effects that are tried beside those chosen, the most promising


def greedy(data: Data) -> Found:
    """Add the effect that lowers the held-out error most, then the next beside it, and so on.

    An effect is added if the set with it predicts better than that without (see `improves`).
    """

    def predict(use: list[Any], e: Experiment) -> Array:
        return free_run(data.machine, e, use)

    chosen: list[Any] = []
    error, tried = block_errors(data.held, partial(predict, [])), data.fits.alone
    for size in range(1, MOST + 1):
        ranked = [(block_errors(data.held, partial(predict, f.use)), f) for f in tried]
        if not ranked:
            break
        best, fitted = min(ranked, key=lambda q: float(q[0].sum()))
        if not improves(error, best):
            break
        chosen, error = fitted.use, best
        if size < MOST:
            tried = data.fits.finished(data.fits.grown(fitted, TRIED))
    return data.with_effects(chosen)
