"""Rows of dots with intervals: several figures of merit of several runs, beside each other."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ldt_core.lab.study.statistics import Interval
from ldt_core.views.page.style import GREY, INK, PAPER, Layout, look, panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROW, TALL_ROW = 0.27, 0.36  # inches; tall where baselines are in it
FRAME = 0.75  # inches that title and labels of a panel take
ABOVE = 0.22  # rows that a run lies above the middle of its row, its baselines below it
ROOM = 1.5  # times the largest figure, at most, is the end of an axis
DASHES = ((0, (1, 1.5)), (0, (5, 2)), (0, (6, 1.5, 1.2, 1.5)))  # of lines across

#: What a run is compared with → its marker and where it lies in the row.
CHANCE = {"never": ("|", 0.0), "periodic": (".", 0.18), "random": ("x", 0.34)}


@dataclass(frozen=True)
class Dots:
    """A row.

    Attributes:
        label: at the left.
        key: model or detector whose colour it has; "" for a heading.
        values: panel → estimate.
        beside: baseline → panel → estimate.
        hollow: a figure that others measured.
    """

    label: str
    key: str = ""
    values: Mapping[str, Interval] = field(default_factory=dict)
    beside: Mapping[str, Mapping[str, Interval]] = field(default_factory=dict)
    hollow: bool = False


@dataclass(frozen=True)
class Panel:
    """An axis of figures of merit.

    Attributes:
        key: in `Dots.values`.
        label: with its unit.
        limits: of the axis; None lets the runs decide, from 0. Baselines, and intervals much wider
            than all figures, do not widen it: what lies beyond is an arrow at the edge.
        lines: (label, value) to draw across.
    """

    key: str
    label: str
    limits: tuple[float, float] | None = None
    lines: Sequence[tuple[str, float]] = ()


def limits(rows: Sequence[Dots], panel: Panel) -> tuple[float, float]:
    """Of the axis of a panel."""
    if panel.limits:
        return panel.limits
    known = [e for row in rows if (e := row.values.get(panel.key)) and e.value is not None]
    highest = max([e.value or 0 for e in known] + [value for _, value in panel.lines], default=1)
    ends = [e.high for e in known if math.isfinite(e.high)]
    return 0, 1.05 * min(max([highest, *ends]), ROOM * highest) or 1


def dot_plot(layout: Layout, rows: Sequence[Dots], axes: Sequence[Panel], columns: int) -> Figure:
    """One panel a figure of merit, one row a run."""
    height = FRAME + (TALL_ROW if any(r.beside for r in rows) else ROW) * len(rows)
    figure, all_axes = panels(layout, height, columns, len(axes))
    for one, panel in zip(all_axes, axes, strict=True):
        _panel(one, rows, panel)
        spec = one.get_subplotspec()
        if spec is not None and spec.is_first_col():
            one.set_yticks(range(len(rows)), [row.label for row in rows])
            for text, row in zip(one.get_yticklabels(), rows, strict=True):
                text.set_fontweight("normal" if row.key else "bold")
        else:
            one.set_yticks([])
        one.tick_params(left=False)
    return figure


def key_to_marks(
    figure: Figure,
    layout: Layout,
    dot: str = "mean over seeds, 95 % interval",
    baselines: bool = False,
    hollow: str = "",
) -> None:
    """A legend of the marks, and of the lines across.

    Args:
        figure: of `dot_plot`.
        layout: its room.
        dot: what a dot is.
        baselines: whether they are drawn.
        hollow: what a hollow dot is; "" without any.
    """
    from matplotlib.lines import Line2D

    def mark(label: str, marker: str, **more: Any) -> Line2D:
        return Line2D([], [], ls="", label=label, marker=marker, **more)

    marks = [mark(dot, "o", color=INK)]
    if hollow:
        marks.append(mark(hollow, "o", mec=INK, mfc=PAPER))
    if baselines:
        for name, (marker, _) in CHANCE.items():
            marks.append(mark(f"{name} alarms" if name != "never" else name, marker, color=GREY))
    lines = [h for axes in figure.axes for h in axes.get_legend_handles_labels()[0]]
    columns = 1 if layout.narrow else 4
    figure.legend(handles=[*marks, *lines], loc="outside upper left", ncols=columns)


def _panel(axes: Axes, rows: Sequence[Dots], panel: Panel) -> None:
    low, high = limits(rows, panel)
    for place, row in enumerate(rows):
        for name, estimates in row.beside.items():
            if panel.key in estimates and name in CHANCE:
                marker, shift = CHANCE[name]
                _dot(axes, place + shift, estimates[panel.key], GREY, marker, 5, None, high)
        if panel.key in row.values:
            style = look(row.key)
            face = PAPER if row.hollow else style.color
            shift = -ABOVE if row.beside else 0.0
            marker = style.marker or "o"
            _dot(axes, place + shift, row.values[panel.key], style.color, marker, 6, face, high)
    for (label, value), dashes in zip(panel.lines, DASHES, strict=False):
        axes.axvline(value, color=INK, lw=1.2, ls=dashes, zorder=1, label=label)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.grid(axis="y", visible=False)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel(panel.label)
    axes.set_xlim(low, high)
    if panel.limits == (0, 1):
        axes.set_xticks([0, 0.5, 1], ["0", "0.5", "1"])


def _dot(
    axes: Axes,
    place: float,
    estimate: Interval,
    color: str,
    marker: str,
    size: float,
    face: str | None,
    edge: float,
) -> None:
    if estimate.value is None:
        return
    if estimate.value > edge:  # an arrow there, with its figure
        axes.plot(edge, place, ">", color=color, ms=5, clip_on=False)
        axes.annotate(
            f"{estimate.value:.3g}",
            (edge, place),
            xytext=(-7, 0),
            textcoords="offset points",
            ha="right",
            va="center",
        )
        return
    if math.isfinite(estimate.low) and math.isfinite(estimate.high):
        axes.plot([estimate.low, estimate.high], [place, place], color=color, lw=1.4)
    face = color if face is None else face
    axes.plot(estimate.value, place, marker, color=color, mfc=face, ms=size, clip_on=False)
