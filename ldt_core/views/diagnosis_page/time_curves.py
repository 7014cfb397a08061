"""Measured against predicted, before and after, of two experiments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import rms
from ldt_core.diagnosis.diagnosis import Diagnosis, DrawnExperiment, NextExperiment
from ldt_core.views.diagnosis_page.number_format import known, value_of
from ldt_core.views.figures.free_run_panels import draw_free_runs
from ldt_core.views.packed_samples import thinned
from ldt_core.views.page.style import BLUE, Drawing, Layout, Panels, legend, panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure


def changed(shown: Sequence[DrawnExperiment]) -> bool:
    """Whether there are effects that change a prediction."""
    return any(not np.array_equal(s.before, s.after, equal_nan=True) for s in shown)


@dataclass(frozen=True)
class ShownFreeRuns(Panels):
    """The experiments that are drawn."""

    chosen: Sequence[tuple[DrawnExperiment, str]]
    noise: float
    after: bool
    held_out: bool

    def height(self, layout: Layout) -> float:
        """Of the figure [inches]."""
        return 0.5 + 3.6 * (len(self.chosen) if layout.narrow else 1)

    def draw(self, figure: Figure | SubFigure, layout: Layout) -> None:
        """Draw them, beside each other where there is room."""
        count = len(self.chosen)
        shape = (2 * count, 1) if layout.narrow else (2, count)
        ratios = [2.0, 1.2] * (count if layout.narrow else 1)
        grid = figure.subplots(*shape, squeeze=False, height_ratios=ratios)
        pairs = grid.reshape(count, 2) if layout.narrow else grid.T
        for index, ((upper, lower), (shown, words)) in enumerate(
            zip(pairs, self.chosen, strict=True)
        ):
            runs = (shown.before, shown.after) if self.after else (shown.before,)
            draw_free_runs(upper, lower, shown.experiment, runs, self.noise)
            upper.set_title(f"experiment {shown.experiment.number}, {words}")
            lower.set_xlabel("time [s]")
            if index == 0 or layout.narrow:
                upper.set_ylabel("speed [rad/s]")
                lower.set_ylabel("error [rad/s]")
        legend(figure, [pairs[0][0]], layout, 4)


def shown_free_runs(diagnosis: Diagnosis) -> ShownFreeRuns | None:
    """The experiment with the largest error before and one with the median; None without any."""
    held = [s for s in diagnosis.shown if s.held_out]
    ranked = sorted(held or diagnosis.shown, key=lambda s: -_error(s, s.before))
    if not ranked:
        return None
    chosen = [(ranked[0], "largest error")]
    if len(ranked) > 1:
        chosen.append((ranked[max(1, len(ranked) // 2)], "typical"))
    return ShownFreeRuns(chosen, diagnosis.gap.noise_std, changed(diagnosis.shown), bool(held))


def before_after(diagnosis: Diagnosis) -> Drawing | None:
    """The figure; None where no experiment is shown."""
    found = shown_free_runs(diagnosis)
    if found is None:
        return None
    kind = "held out" if found.held_out else "fitted"
    words = "; ".join(f"experiment {s.experiment.number} ({w}): {_rms(s)}" for s, w in found.chosen)
    runs, title = "by the machine file; no effect was added", "Measured against predicted"
    if found.after:
        runs = "by the machine file (before) and with the verdict's effects (after)"
        title += ", before and after"
    return Drawing(
        "curves",
        title,
        f"Free runs of experiments that were {kind}, {runs}. Root mean square error [rad/s]: "
        f"{words}. Shaded: 95 % band of the sensor noise.",
        "Speed over time as it was measured and as it is predicted, and the error of the "
        f"predictions below it. {words}.",
        found.alone,
    )


def _error(shown: DrawnExperiment, predicted: np.ndarray) -> float:
    """Root mean square; without bound where the prediction diverges."""
    error = rms(shown.experiment.speed - predicted)
    return error if known(error) else np.inf


def _rms(shown: DrawnExperiment) -> str:
    before, after = (_error(shown, p) for p in (shown.before, shown.after))
    words = "diverges" if not known(before) else value_of(before)
    if np.array_equal(shown.before, shown.after, equal_nan=True):
        return words
    return f"{words} before, {value_of(after) if known(after) else 'diverges'} after"


def voltage(following: NextExperiment) -> Drawing:
    """Its voltage over time."""
    volts = np.asarray(following.voltage, dtype=np.float64)
    period = following.sample_period
    duration = volts.size * period
    time, level = corners(volts, period)

    def draw(layout: Layout) -> Figure:
        figure, (axes,) = panels(layout, 1.8)
        axes.plot(*thinned(time, level), color=BLUE, lw=1.4)
        axes.set_xlim(0, duration)
        axes.set_xlabel("time [s]")
        axes.set_ylabel("voltage [V]")
        return figure

    words = (
        f"{value_of(duration)} s between {value_of(float(volts.min()))} and "
        f"{value_of(float(volts.max()))} V"
    )
    return Drawing(
        "voltage",
        "Voltage of the next experiment",
        f"{words[0].upper()}{words[1:]}; each sample held for {period:g} s.",
        f"The voltage over time, {words}.",
        draw,
    )


def corners(volts: Array, period: float) -> tuple[Array, Array]:
    """(time [s], voltage [V]) of the corners of a row of held levels."""
    switch = np.flatnonzero(np.diff(volts)) + 1
    begin = np.concatenate([[0], switch]) * period
    end = np.concatenate([switch, [volts.size]]) * period
    level = volts[np.concatenate([[0], switch])]
    return np.column_stack([begin, end]).ravel(), np.repeat(level, 2)
