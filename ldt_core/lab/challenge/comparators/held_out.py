"""Whether a model predicts held-out experiments better than another, beyond chance."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.experiment import Experiment

Array = NDArray[np.float64]

BLOCKS = 5  # of an experiment, among which an improvement's scatter is judged
DIVERGED = 1e12  # (rad/s)^2, in place of the error of a free run that grows for ever


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
