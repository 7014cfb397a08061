"""Panels of free runs before and after: speed as measured and as predicted, and the errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Experiment, rms
from ldt_core.calibration.calibration import Calibration
from ldt_core.models.physics import PhysicsModel
from ldt_core.recording.bag import Bag
from ldt_core.views.export.predicted_runs import Predictions
from ldt_core.views.packed_samples import thinned
from ldt_core.views.page import style
from ldt_core.views.page.style import BLUE, INK, SHADE, SKY, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

T = TypeVar("T")

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
    models = PhysicsModel(calibration.nominal), PhysicsModel(calibration.machine)
    shown = [(e, tuple(m.predict(e).speed for m in models)) for e in _spread_panels(experiments)]
    held = "held out" if "held_out" in calibration.errors else "fitted"
    _draw_panels(
        shown, f"{calibration.machine.name}: free runs of experiments that were {held}", file
    )


def draw_predictions(
    recording: Bag, file: str | Path, title: str = "", number: int | None = None
) -> list[int]:
    """Draw what `ldt predict` wrote: measured and predicted speed of three experiments, or of one.

    Returns:
        The numbers of the experiments that are shown.

    Raises:
        OptionError: no such experiment, none that was predicted, or no file of a picture.
    """
    style.check_picture(file)
    beside = Predictions(recording).beside
    runs = map(beside, recording.experiments())
    numbers = [r.experiment.number for r in runs if r.prediction is not None]
    wanted = [number] if number is not None else _spread_panels(numbers)
    if not wanted or not set(wanted) <= set(numbers):
        expected = f"one of {min(numbers)} to {max(numbers)}" if numbers else "a predicted one"
        raise OptionError("experiment", f"{expected} in {recording.path}", number)
    shown = [
        (r.experiment, (r.prediction.speed,))
        for r in map(beside, recording.experiments())
        if r.prediction is not None and r.experiment.number in wanted
    ]
    _draw_panels(shown, title or f"{recording.path.name}: free runs", file)
    return wanted


def _spread_panels(given: Sequence[T]) -> list[T]:
    """As many as there is room for, evenly spread."""
    at = np.unique(np.linspace(0, len(given) - 1, min(PANELS, len(given))).round())
    return [given[int(i)] for i in at]


def _draw_panels(
    shown: Sequence[tuple[Experiment, tuple[Array, ...]]], title: str, file: str | Path
) -> None:
    """Draw experiments side by side: speed, error, voltage.

    Args:
        shown: of each its (L,) predicted speeds [rad/s], before and perhaps after.
    """

    def draw(figure: Figure) -> None:
        axes = figure.subplots(
            3, len(shown), squeeze=False, sharex="col", sharey="row", height_ratios=[3, 2, 1]
        )
        for (speed, error, voltage), (e, runs) in zip(axes.T, shown, strict=True):
            draw_free_runs(speed, error, e, runs)
            voltage.step(e.time, e.voltage, color=style.INK, lw=1.0, where="post")
            sizes = [f"{rms(e.speed - run):.3g}" for run in runs]
            told = f"{sizes[0]} before, {sizes[-1]} after" if len(sizes) > 1 else sizes[0]
            wrapped = "\n" if len(shown) > 1 else " "  # a narrow panel has room for half of it
            speed.set_title(f"experiment {e.number}: root mean square error{wrapped}{told} rad/s")
            voltage.set_xlabel("time [s]")
        for row, label in zip(axes, ("speed [rad/s]", "error [rad/s]", "voltage [V]"), strict=True):
            row[0].set_ylabel(label)
        axes[0, 0].legend(loc="best")
        figure.suptitle(title)

    width = max(style.WIDE.width, 1.5 + 3.8 * len(shown))
    style.save_picture(style.picture(width, HEIGHT, draw), file)
