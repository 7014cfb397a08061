"""Panels of free runs before and after: speed as measured and as predicted, and the errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment, rms
from ldt_core.calibration.calibration import Calibration
from ldt_core.models.physics import PhysicsModel
from ldt_core.views.packed_samples import thinned
from ldt_core.views.page import style
from ldt_core.views.page.style import BLUE, INK, SHADE, SKY, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


#: Label, colour, line, width above and below. A run that is right shows as a rim of the measured.
LOOKS = (
    ("before", VERMILION, (0, (4, 1.4)), 1.4, 0.8),
    ("after", SKY, "-", 3.2, 0.8),
)

HEIGHT = 6.0  # inches
PANELS = 3  # experiments shown side by side: more would be too narrow to read


def draw_free_runs(
    upper: Axes, lower: Axes, e: Experiment, runs: tuple[Array, ...], noise: float = 0.0
) -> None:
    """Draw the speed above and the error of the predictions below.

    Args:
        runs: (L,) predicted speed [rad/s], before and perhaps after.
        noise: deviation of the measured speed [rad/s]; twice that is shaded.
    """
    lower.axhspan(-2 * noise, 2 * noise, color=SHADE, lw=0, zorder=0)
    for predicted, (when, color, line, wide, thin) in zip(runs, LOOKS, strict=False):
        label = when if len(runs) > 1 else "predicted"
        upper.plot(*thinned(e.time, predicted), lw=wide, color=color, ls=line, label=label)
        shown = BLUE if color == SKY else color  # a thin line of it is hard to see
        lower.plot(*thinned(e.time, e.speed - predicted), lw=thin, color=shown)
    upper.plot(*thinned(e.time, e.speed), color=INK, lw=0.9, label="measured")
    for axes in (upper, lower):
        axes.set_xlim(0, e.duration)
        axes.locator_params(axis="x", nbins=5)
    upper.tick_params(labelbottom=False)


def draw_calibration(
    calibration: Calibration, experiments: Sequence[Experiment], file: str | Path
) -> None:
    """Draw the experiments held out (or those fitted, when none were), at most three of them."""
    at = np.unique(np.linspace(0, len(experiments) - 1, min(PANELS, len(experiments))).round())
    shown = [experiments[int(i)] for i in at]
    models = PhysicsModel(calibration.nominal), PhysicsModel(calibration.machine)
    held = "held out" if "held_out" in calibration.errors else "fitted"

    def draw(figure: Figure) -> None:
        axes = figure.subplots(
            3, len(shown), squeeze=False, sharex="col", sharey="row", height_ratios=[3, 2, 1]
        )
        for (speed, error, voltage), e in zip(axes.T, shown, strict=True):
            runs = tuple(model.predict(e).speed for model in models)
            draw_free_runs(speed, error, e, runs)
            voltage.step(e.time, e.voltage, color=style.INK, lw=1.0, where="post")
            before, after = (rms(e.speed - run) for run in runs)
            speed.set_title(
                f"experiment {e.number}: root mean square error\n"
                f"{before:.3g} before, {after:.3g} after [rad/s]"
            )
            voltage.set_xlabel("time [s]")
        for row, label in zip(axes, ("speed [rad/s]", "error [rad/s]", "voltage [V]"), strict=True):
            row[0].set_ylabel(label)
        axes[0, 0].legend(loc="best")
        figure.suptitle(f"{calibration.machine.name}: free runs of experiments that were {held}")

    width = max(style.WIDE.width, 1.5 + 3.8 * len(shown))
    style.save_picture(style.picture(width, HEIGHT, draw), file)
