"""Effects selected by held-out error, or by the likelihood of white residuals.

Held-out error is the usual way to extend a model by hand. Information criteria set the likelihood
against the number of parameters: Akaike, A new look at the statistical model identification, IEEE
Transactions on Automatic Control 19 (1974) 716; Schwarz, Estimating the dimension of a model,
Annals of Statistics 6 (1978) 461.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.effect_fit import EffectFit
from ldt_core.diagnosis.holdout import free_run
from ldt_core.lab.challenge.comparators.compare import ComparatorAnswer, Data, EffectFits

BLOCKS = 5  # of an experiment, among which an improvement's scatter is judged
DIVERGED = 1e12  # (rad/s)^2, in place of the error of a free run that grows for ever
MOST_EFFECTS = 3  # effects
EFFECTS_TRIED = 8  # effects that are tried beside those chosen, the most promising
PAIRS_TRIED = 10  # whose responses together promise most
BASES_BUILT_UPON, ADDED_TO_EACH = 2, 5  # effects built upon, and effects tried beside each


def block_errors(held: Sequence[Experiment], predict: Callable[[Experiment], Array]) -> Array:
    """Sum of squared errors of each block of the experiments [(rad/s)^2]."""
    found = []
    for e in held:
        square = np.nan_to_num((e.speed - predict(e)) ** 2, nan=DIVERGED, posinf=DIVERGED)
        found += [float(part.sum()) for part in np.array_split(square, BLOCKS)]
    return np.array(found)


def improves(before: Array, after: Array) -> bool:
    """Whether errors fall by more than one standard error of their fall.

    The one-standard-error rule: Breiman and others, Classification and Regression Trees, 1984.
    """
    gain = before - after
    return bool(gain.mean() > gain.std(ddof=1) / math.sqrt(gain.size))


def greedy(data: Data) -> ComparatorAnswer:
    """Add the effect that lowers the held-out error most, then the next beside it, and so on.

    An effect is added if the set with it predicts better than that without (see `improves`).
    """

    def predict(use: list[Any], e: Experiment) -> Array:
        return free_run(data.machine, e, use)

    chosen: list[Any] = []
    error, tried = block_errors(data.held, partial(predict, [])), data.fits.alone
    for size in range(1, MOST_EFFECTS + 1):
        ranked = [(block_errors(data.held, partial(predict, f.use)), f) for f in tried]
        if not ranked:
            break
        best, fitted = min(ranked, key=lambda q: float(q[0].sum()))
        if not improves(error, best):
            break
        chosen, error = fitted.use, best
        if size < MOST_EFFECTS:
            tried = data.fits.finished(data.fits.grown(fitted, EFFECTS_TRIED))
    return data.with_effects(chosen)


def akaike(data: Data) -> ComparatorAnswer:
    """The least n ln(loss / n) + 2 k among no effect, single effects and pairs."""
    return _least(data, 2.0)


def bayes(data: Data) -> ComparatorAnswer:
    """The least n ln(loss / n) + k ln(n)."""
    return _least(data, math.log(data.fits.bench.size))


def _least(data: Data, price: float) -> ComparatorAnswer:
    """The set with the least criterion.

    Args:
        data: of the case.
        price: of a parameter.
    """
    fits, size = data.fits, data.fits.bench.size
    loss = float(fits.base @ fits.base)
    best: tuple[float, EffectFit | None] = (size * math.log(loss / size), None)
    for f in [*fits.alone, *data.shared("pairs", lambda: _pairs(fits))]:
        value = size * math.log(max(f.loss, 1e-300) / size) + price * f.free
        best = min(best, (value, f), key=lambda q: q[0])
    return data.with_effects(best[1].use if best[1] else [])


def _pairs(fits: EffectFits) -> list[EffectFit]:
    found = fits.pairs(PAIRS_TRIED)
    for base in fits.alone[:BASES_BUILT_UPON]:
        found += fits.grown(base, ADDED_TO_EACH)
    return fits.finished(found)
