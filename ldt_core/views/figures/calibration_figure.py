"""A figure of the calibration: measured, before and after, over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ldt_core.base.experiment import Experiment, rms
from ldt_core.base.result_files import check_target
from ldt_core.calibration.calibration import Calibration
from ldt_core.models.physics import PhysicsModel
from ldt_core.views.page import style

PANELS = 3  # experiments shown side by side
BEFORE, AFTER = "#d55e00", "#0072b2"  # told apart by the colour-blind as well (Okabe and Ito)


def check_figure(file: str | Path) -> None:
    """Refuse a figure that cannot be drawn, before any work is done.

    Raises:
        OptionError: an ending that is no picture's, or a folder that does not exist.
        LdtError: matplotlib is not installed.
    """
    check_target(file, "--figure", style.PICTURES)
    style.require("--figure")


def draw(calibration: Calibration, experiments: Sequence[Experiment], file: str | Path) -> None:
    """Draw the experiments held out (or those fitted, when none were), at most three of them.

    Args:
        calibration: what was found.
        experiments: the same that were calibrated.
        file: .png, .svg or .pdf.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = _shown(experiments)
    before, after = PhysicsModel(calibration.nominal), PhysicsModel(calibration.machine)
    figure = Figure(figsize=(max(7.5, 1.5 + 3.8 * len(shown)), 6.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(
        3, len(shown), squeeze=False, sharex="col", sharey="row", height_ratios=[3, 2, 1]
    )
    for (speed, error, voltage), e in zip(axes.T, shown, strict=True):
        was, now = before.predict(e), after.predict(e)
        speed.plot(e.time, e.speed, color="black", lw=2.4, alpha=0.55, label="measured")
        speed.plot(e.time, was.speed, color=BEFORE, lw=1.3, ls="--", label="before")
        speed.plot(e.time, now.speed, color=AFTER, lw=1.3, label="after")
        error.axhline(0, color="grey", lw=0.6)
        error.plot(e.time, was.residual(e), color=BEFORE, lw=1.0, ls="--")
        error.plot(e.time, now.residual(e), color=AFTER, lw=1.0)
        voltage.step(e.time, e.voltage, color="black", lw=1.0, where="post")
        speed.set_title(
            f"experiment {e.number}: root mean square error\n"
            f"{rms(was.residual(e)):.3g} before, {rms(now.residual(e)):.3g} after [rad/s]",
            fontsize=9,
        )
        voltage.set_xlabel("time [s]")
    for row, label in zip(axes, ("speed [rad/s]", "error [rad/s]", "voltage [V]"), strict=True):
        row[0].set_ylabel(label)
        for axis in row:
            axis.grid(alpha=0.25)
            axis.margins(x=0.01)
    axes[0, 0].legend(frameon=False, fontsize=9, loc="best")
    held = "held out" if "held_out" in calibration.errors else "fitted"
    figure.suptitle(f"{calibration.machine.name}: free runs of experiments that were {held}")
    figure.savefig(file, dpi=130, metadata={"Date": None} if str(file).endswith("svg") else None)


def _shown(experiments: Sequence[Experiment]) -> list[Experiment]:
    at = np.unique(np.linspace(0, len(experiments) - 1, min(PANELS, len(experiments))).round())
    return [experiments[int(i)] for i in at]
