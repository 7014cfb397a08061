"""Information criteria: the likelihood of white residuals against the number of parameters.

Akaike, A new look at the statistical model identification, IEEE Transactions on Automatic Control
19 (1974) 716; Schwarz, Estimating the dimension of a model, Annals of Statistics 6 (1978) 461.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ldt_core.diagnosis.effect_fit import EffectFit

if TYPE_CHECKING:
    from ldt_core.lab.challenge.comparators.compare import Data, Found
    from ldt_core.lab.challenge.comparators.fits import Fits

PAIRS = 10  # whose responses together promise most
BASES, ADDED = 2, 5  # effects built upon, and effects tried beside each


def akaike(data: Data) -> Found:
    """The least n ln(loss / n) + 2 k among no effect, single effects and pairs."""
    return _least(data, 2.0)


def bayes(data: Data) -> Found:
    """The least n ln(loss / n) + k ln(n)."""
    return _least(data, math.log(data.fits.bench.size))


def _least(data: Data, price: float) -> Found:
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


def _pairs(fits: Fits) -> list[EffectFit]:
    found = fits.pairs(PAIRS)
    for base in fits.alone[:BASES]:
        found += fits.grown(base, ADDED)
    return fits.finished(found)
