"""Where the gap lies: the torque that would explain it, over all that it may depend on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.sentences import counted, listed
from ldt_core.diagnosis.diagnosis import Diagnosis, DrawnExperiment, GapLocation
from ldt_core.views.diagnosis_page.number_format import percent, unit_of, value_of
from ldt_core.views.diagnosis_page.signal_curves import MOST_ORDER, Binned, binned, orders, spectrum
from ldt_core.views.diagnosis_page.time_curves import changed
from ldt_core.views.page.style import (
    BLUE,
    INK,
    SHADE,
    VERMILION,
    Drawing,
    Layout,
    Panels,
    legend,
    power,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

QUANTITIES = {
    "speed": "speed [rad/s]",
    "voltage": "voltage [V]",
    "acceleration": "acceleration [rad/s²]",
    "time": "time in the experiment [s]",
}
SPECTRA = {"frequency": "frequency [Hz]", "order": "shaft order [1/turn]"}
SPECTRAL = ("density [mN m/√Hz]", "amplitude [mN m]")
COLUMNS = 2  # of panels, where there is room
ROW = 2.05  # inches of a row of panels
EVERYWHERE = 0.999  # of the samples: a place with more of them is not marked
LEAST_ORDER = 2.0  # per turn, that the axis of the shaft's orders reaches at least
MILLI_BELOW = 0.2  # N m, below which torques are given in mN m
TICKS = 5  # along an axis: accelerations of thousands would run into each other
FLOOR = 1e-4  # of its peak, below which a spectrum is not drawn
LOOKS = (("before", VERMILION, 3), ("after", BLUE, 2))  # label, colour, layer


@dataclass(frozen=True)
class GapCurves(Panels):
    """The curves, by quantity, before and, where effects were added, after.

    Attributes:
        spectra: (x, y) each.
        marked: places to mark, by quantity.
        scale: of torques from N m.
    """

    bins: Mapping[str, Sequence[Binned]]
    spectra: Mapping[str, Sequence[tuple[Array, Array]]]
    marked: Mapping[str, Sequence[GapLocation]]
    scale: float
    unit: str

    def height(self, layout: Layout) -> float:
        """Of the figure [inches]."""
        rows = 6 if layout.narrow else 6 // COLUMNS
        return 0.4 + ROW * rows

    def draw(self, figure: Figure | SubFigure, layout: Layout) -> None:
        """Draw all panels."""
        columns = 1 if layout.narrow else COLUMNS
        grid = list(figure.subplots(6 // columns, columns, squeeze=False).flat)
        for axes, (name, label) in zip(grid, QUANTITIES.items(), strict=False):
            _over(axes, self, name)
            axes.set_xlabel(label)
        for axes, (name, label) in zip(grid[len(QUANTITIES) :], SPECTRA.items(), strict=True):
            _spectrum(axes, self, name)
            axes.set_xlabel(label)
        for index, axes in enumerate(grid):
            _mark(axes, self.marked.get([*QUANTITIES, *SPECTRA][index], ()))
            if index < len(QUANTITIES) and index % columns == 0:
                axes.set_ylabel(f"torque [{self.unit}]")
        for axes, label in zip(grid[len(QUANTITIES) :], SPECTRAL, strict=True):
            axes.set_ylabel(label)
        legend(figure, grid, layout, 4)


def gap_curves(diagnosis: Diagnosis) -> GapCurves | None:
    """What to draw; None where no experiment is shown."""
    shown = diagnosis.shown
    if not shown:
        return None
    torques = [[_known(s.torque_before, s.before) for s in shown]]
    if changed(shown):
        torques.append([_known(s.torque_after, s.after) for s in shown])
    periods = [s.experiment.period for s in shown]
    speeds = [s.smooth_speed for s in shown]
    over = {name: np.concatenate([_row(s, name) for s in shown]) for name in QUANTITIES}
    bins = {n: [binned(x, np.concatenate(t)) for t in torques] for n, x in over.items()}
    spectra = {
        "frequency": [spectrum(t, periods) for t in torques],
        "order": [orders(t, speeds, periods) for t in torques],
    }
    largest = max((float(np.abs(b.mean).max()) for b in bins["speed"] if b.mean.size), default=1)
    scale, unit = (1e3, "mN m") if largest < MILLI_BELOW else (1.0, "N m")
    marked: dict[str, list[GapLocation]] = {}
    for place in diagnosis.where:
        if place.share_of_data < EVERYWHERE and not place.steady:
            marked.setdefault(place.quantity, []).append(place)
    return GapCurves(bins, spectra, marked, scale, unit)


def torque_drawing(diagnosis: Diagnosis) -> Drawing | None:
    """The figure; None where no experiment is shown."""
    found = gap_curves(diagnosis)
    if found is None:
        return None
    words = [where(p) for some in found.marked.values() for p in some]
    marked = f" Marked: {'; '.join(words)}." if words else " No place stands out."
    return Drawing(
        "places",
        "The torque on the shaft that would explain the error",
        f"From {counted(len(diagnosis.shown), 'experiment')}. Over each quantity: the mean, and a "
        "band that holds four of five samples; below: its spectrum over frequency, and over orders "
        f"of the shaft (1 repeats with each turn).{marked}",
        f"Six panels: the torque over {listed(QUANTITIES)}, and its spectra over frequency and "
        f"shaft order.{marked}",
        found.alone,
    )


def where(place: GapLocation) -> str:
    """A place in words."""
    return f"{place.quantity} {span(place)} ({shares(place)})"


def span(place: GapLocation) -> str:
    """From where to where."""
    ends = place.begin, place.end
    if place.quantity == "experiment":
        return " to ".join(f"{end:.0f}" for end in dict.fromkeys(ends))
    return f"{' to '.join(map(value_of, ends))} {unit_of(place.unit)}".rstrip()


def shares(place: GapLocation) -> str:
    """How much of the gap and of the data it holds."""
    return f"{percent(place.share_of_gap)} of the gap, {percent(place.share_of_data)} of the data"


def _over(axes: Axes, found: GapCurves, name: str) -> None:
    for curve, (label, color, layer) in zip(found.bins[name], LOOKS, strict=False):
        x, scale = curve.x, found.scale
        axes.fill_between(
            x, scale * curve.low, scale * curve.high, color=color, alpha=0.2, lw=0, zorder=layer
        )
        axes.plot(x, scale * curve.mean, color=color, lw=1.4, label=label, zorder=layer + 2)
    axes.axhline(0, color=INK, lw=0.6, zorder=1)
    axes.locator_params(axis="x", nbins=TICKS)


def _spectrum(axes: Axes, found: GapCurves, name: str) -> None:
    peak = 0.0
    for (x, y), (label, color, layer) in zip(found.spectra[name], LOOKS, strict=False):
        seen = y > 0
        if seen.any():
            peak = max(peak, 1e3 * float(y.max()))
            axes.plot(x[seen], 1e3 * y[seen], color=color, lw=1.1, label=label, zorder=layer)
    if not peak:
        axes.text(0.5, 0.5, "too little motion", ha="center", transform=axes.transAxes)
        return
    axes.set_yscale("log")
    low = max(axes.get_ylim()[0], FLOOR * peak)
    axes.set_ylim(*(10.0 ** f(math.log10(y)) for f, y in ((math.floor, low), (math.ceil, peak))))
    axes.yaxis.set_major_formatter(power)
    if name == "frequency":
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(power)
    else:
        furthest = max((float(f[-1]) for f, _ in found.spectra[name] if f.size), default=MOST_ORDER)
        axes.set_xlim(0, max(furthest, LEAST_ORDER))
    axes.minorticks_off()


def _mark(axes: Axes, marked: Sequence[GapLocation]) -> None:
    if not marked:
        return
    low, high = axes.get_xlim()
    for index, place in enumerate(marked):
        # A place as narrow as one line of a spectrum is still to be seen.
        begin, end = max(place.begin, low), min(place.end, high)
        label = None if index else "place of the gap"
        axes.axvspan(begin, end, color=SHADE, lw=0, zorder=0, label=label)
        for edge in (begin, end):
            axes.axvline(edge, color=SHADE, lw=1.6, zorder=0)
    axes.set_xlim(low, high)
    axes.set_title(shares(marked[0]))


def _known(torque: Array, predicted: Array) -> Array:
    """The torque where there is a prediction; a free run that diverges tells nothing."""
    return np.where(np.isfinite(predicted), torque, math.nan)


def _row(shown: DrawnExperiment, name: str) -> Array:
    rows = {
        "speed": shown.smooth_speed,
        "voltage": shown.experiment.voltage,
        "acceleration": shown.acceleration,
        "time": shown.experiment.time,
    }
    return np.asarray(rows[name], dtype=np.float64)
