"""A figure of the calibration: measured, before and after, over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ldt_core.base.experiment import Experiment, rms
from ldt_core.calibration.calibration import Calibration
from ldt_core.models.physics import PhysicsModel
from ldt_core.views.figures.free_run_panels import draw_free_runs
from ldt_core.views.page import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEIGHT = 6.0  # inches
PANELS = 3  # experiments shown side by side: more would be too narrow to read


def draw_calibration(
    calibration: Calibration, experiments: Sequence[Experiment], file: str | Path
) -> None:
    """Draw the experiments held out (or those fitted, when none were), at most three of them.

    Args:
        calibration: what was found.
        experiments: the same that were calibrated.
        file: .png, .svg or .pdf.
    """
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
