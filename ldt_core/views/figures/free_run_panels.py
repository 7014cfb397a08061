"""Panels of free runs before and after: speed as measured and as predicted, and the errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.experiment import Experiment
from ldt_core.views.packed_samples import thinned
from ldt_core.views.page.style import BLUE, INK, SHADE, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

LOOKS = (("before", VERMILION, (0, (4, 1.4))), ("after", BLUE, "-"))


def draw_free_runs(
    upper: Axes, lower: Axes, e: Experiment, runs: tuple[Array, ...], noise: float = 0.0
) -> None:
    """Draw the speed above and the error of the predictions below.

    Args:
        upper: axes of the speed.
        lower: axes of the error.
        e: measured.
        runs: (L,) predicted speed [rad/s], before and perhaps after.
        noise: deviation of the measured speed [rad/s]; twice that is shaded.
    """
    upper.plot(*thinned(e.time, e.speed), color=INK, lw=2.2, alpha=0.5, label="measured")
    lower.axhspan(-2 * noise, 2 * noise, color=SHADE, lw=0, zorder=0)
    for predicted, (label, color, line) in zip(runs, LOOKS, strict=False):
        upper.plot(*thinned(e.time, predicted), lw=1.3, color=color, ls=line, label=label)
        lower.plot(*thinned(e.time, e.speed - predicted), lw=0.8, color=color)
    for axes in (upper, lower):
        axes.set_xlim(0, e.duration)
        axes.locator_params(axis="x", nbins=5)
    upper.tick_params(labelbottom=False)
