"""Whether the columns of a recording are swapped: the voltage would follow the speed.

A cause helps to predict its effect beyond what the effect's own past tells (Granger, Econometrica
37, 1969). The voltage moves the speed; where somebody sets it beforehand, the speed says nothing of
it, and where a controller does, both help to predict each other. A speed that the voltage says
nothing of, while it plainly says what the voltage will be, is the voltage's column.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.special import fdtrc

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment

#: Samples of the past: two states of a motor, and one for the noise of a measurement.
LAGS = 3
#: Enough for what is to be seen at once; more would cost memory.
MOST_SAMPLES = 100_000
#: Share of the recordings without a cause in which chance makes one seem to be there: of the
#: voltage, so that no weak one is missed; of the speed, so that nothing is told without need.
CHANCE, NO_CHANCE = 0.01, 1e-9
QUESTION = (
    "the speed tells what the voltage will be, and the voltage tells nothing of the speed: are the "
    "two columns swapped?"
)


def swapped(experiments: Iterable[Experiment]) -> str:
    """That the voltage follows the speed and not the other way round, in words; "" if not."""
    pairs: list[tuple[Array, Array]] = []
    for e in experiments:
        left = MOST_SAMPLES - sum(len(v) for v, _ in pairs)
        if min(left, len(e)) > LAGS + 1:
            pairs.append((e.voltage[:left], e.speed[:left]))
    if not pairs or _chance(pairs) < CHANCE:
        return ""
    return "" if _chance([(w, v) for v, w in pairs]) > NO_CHANCE else QUESTION


def _chance(pairs: Sequence[tuple[Array, Array]]) -> float:
    """Probability by chance of what (cause, effect) shows, by an F test of the cause's past."""
    rows = [_past(cause, effect) for cause, effect in pairs]
    own, both, after = (np.concatenate([r[i] for r in rows]) for i in range(3))
    size = float(np.abs(after).max())
    apart = len(after) - both.shape[1]
    if apart < 1 or all(effect.min() == effect.max() for _, effect in pairs):  # nothing moves it
        return 1.0
    alone, together = (_left(columns, after / size) for columns in (own, both))
    # Below that nothing is left but rounding.
    least = len(after) * (LAGS * np.finfo(np.float64).eps) ** 2
    ratio = max(alone - together, 0.0) / LAGS / (max(together, least) / apart)
    return float(fdtrc(LAGS, apart, ratio))


def _past(cause: Array, effect: Array) -> tuple[Array, Array, Array]:
    """Own past, both pasts, and what came after; each by size, with a column of ones."""
    count = len(effect) - LAGS
    lagged = [
        np.column_stack([x[LAGS - 1 - k : LAGS - 1 - k + count] for k in range(LAGS)])
        for x in (effect, cause)
    ]
    ones = np.ones((count, 1))
    own = np.hstack([ones, lagged[0]])
    return own, np.hstack([own, lagged[1]]), effect[LAGS:]


def _left(columns: Array, after: Array) -> float:
    """Sum of squares that they leave."""
    scale = np.abs(columns).max(axis=0)
    columns = columns / np.where(scale > 0, scale, 1.0)
    fit, *_ = np.linalg.lstsq(columns, after, rcond=None)
    return float(np.sum((after - columns @ fit) ** 2))
