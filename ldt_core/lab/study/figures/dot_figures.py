"""Rows of dots with intervals, one for each model and detector: shares and false alarms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ldt_core.base.sentences import number
from ldt_core.lab.statistics import Interval, mean, rate
from ldt_core.lab.study.study import Evidence
from ldt_core.lab.study.study_tables import PAPER as PRINTED
from ldt_core.views.page.style import INK, PAPER, Drawing, Layout, look, pair, panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STATED = "false_alarm_every"  # parameter of a detector that states its rate
ROW = 0.27  # inches
FRAME = 0.75  # inches that title and labels of a panel take
DASHES = ((0, (1, 1.5)), (0, (5, 2)), (0, (6, 1.5, 1.2, 1.5)))  # of lines across


@dataclass(frozen=True)
class Dots:
    """A row.

    Attributes:
        label: at the left.
        key: model or detector whose colour it has; "" for a heading.
        estimate: of the run.
        hollow: a figure that others measured.
    """

    label: str
    key: str = ""
    estimate: Interval | None = None
    hollow: bool = False


def shares(evidence: Evidence) -> Drawing | None:
    """MME as a share of the original's; None without runs."""
    rows = [Dots("the paper, on its rotor")]
    for model, printed in PRINTED.items():
        exact = Interval(100 * printed["share"], -math.inf, math.inf, 1)
        rows.append(Dots(model, model, exact, hollow=True))
    best: list[tuple[float, str]] = []
    for group, heading in (("paper", "here, as in the paper"), ("better", "here, beyond it")):
        pairs = evidence.study.pairs(group)
        rows += [Dots(heading)] if pairs else []
        for (model, detector), results in pairs.items():
            found = evidence.of(results, "share")
            value = None if found.value is None else 100 * found.value
            estimate = Interval(value, 100 * found.low, 100 * found.high, found.count)
            name = pair(model, detector)
            rows.append(Dots(name, model, estimate))
            if value is not None:
                best.append((value, f"{name}: {estimate.text('%')}"))
    if not best:
        return None
    references = _references(evidence)
    words = "".join(f"; {label}: {value:.1f} %" for label, value in references)

    def draw(layout: Layout) -> Figure:
        label = "MME [% of the original model's]"
        return dot_plot(layout, rows, label, 105, references, hollow="the paper's figure")

    return Drawing(
        "shares",
        "What is left of the original model's error",
        f"The least is left by {min(best)[1]}{words}. The paper's hybrid model left 68 %.",
        "Rows of dots: mean maximum error of each learner in per cent of the original model's, "
        "with lines for the references, true models that know the cause.",
        draw,
    )


def false_alarms(evidence: Evidence) -> Drawing | None:
    """False alarms of each detector on streams without drift; None without such streams."""
    rows, stated, words = [], set(), []
    for (model, detector), every_result in evidence.study.pairs("control").items():
        results = [r for r in every_result if len(set(r.truth)) == 1 and r.case.alarms is None]
        if not results:
            continue
        events = sum(len(r.positives) for r in results)
        exposure = sum(len(r.number) for r in results)
        found = rate(events, exposure)
        rows.append(Dots(pair(model, detector), model, found))
        if detector == "adequacy":
            every = float(results[0].case.resolved[STATED])
            stated.add(1 / every)
            kept = found.low <= 1 / every
            words.append(
                f"Stated for the adequacy detector ({model}): at most one in {every:g}; observed: "
                f"{events} in {exposure} experiments, 95 % interval one in "
                f"{_every(found.high)} to one in {_every(found.low)}, which "
                f"{'allows' if kept else 'lies above'} what was stated."
            )
    if not rows:
        return None
    lines = [("stated", value) for value in sorted(stated)]
    highest = max([e.high for r in rows if (e := r.estimate)] + [value for _, value in lines])

    def draw(layout: Layout) -> Figure:
        label = "false alarms an experiment"
        return dot_plot(layout, rows, label, 1.05 * highest, lines, "rate, exact 95 % interval")

    caption = " ".join(words) or "None of the detectors here states a rate."
    return Drawing(
        "false_alarms",
        "Stated and observed false alarms, on streams without drift",
        f"{caption} Intervals are exact (Poisson).",
        "Rows of dots: rate of false alarms of each detector with its interval, and a line at "
        "the stated rate.",
        draw,
    )


def dot_plot(
    layout: Layout,
    rows: Sequence[Dots],
    label: str,
    highest: float,
    lines: Sequence[tuple[str, float]],
    dot: str = "mean over seeds, 95 % interval",
    hollow: str = "",
) -> Figure:
    """One row a run on an axis from 0, with a legend of the marks and of the lines across.

    Args:
        layout: room that the figure has.
        rows: from top to bottom.
        label: of the axis, with its unit.
        highest: end of the axis; what lies beyond is an arrow at the edge.
        lines: (label, value) to draw across.
        dot: what a dot is.
        hollow: what a hollow dot is; "" without any.
    """
    from matplotlib.lines import Line2D

    figure, (axes,) = panels(layout, FRAME + ROW * len(rows))
    for place, row in enumerate(rows):
        if row.estimate is not None and row.estimate.value is not None:
            _dot(axes, place, row, row.estimate, row.estimate.value, highest)
    for (words, value), dashes in zip(lines, DASHES, strict=False):
        axes.axvline(value, color=INK, lw=1.2, ls=dashes, zorder=1, label=words)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_yticks(range(len(rows)), [row.label for row in rows])
    for text, row in zip(axes.get_yticklabels(), rows, strict=True):
        text.set_fontweight("normal" if row.key else "bold")
    axes.grid(axis="y", visible=False)
    axes.spines["left"].set_visible(False)
    axes.tick_params(left=False)
    axes.set_xlabel(label)
    axes.set_xlim(0, highest)
    marks = [Line2D([], [], ls="", label=dot, marker="o", color=INK)]
    if hollow:
        marks.append(Line2D([], [], ls="", label=hollow, marker="o", mec=INK, mfc=PAPER))
    handles = [*marks, *axes.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside upper left", ncols=1 if layout.narrow else 2)
    return figure


def _dot(
    axes: Axes, place: int, row: Dots, estimate: Interval, value: float, highest: float
) -> None:
    style = look(row.key)
    if value > highest:  # an arrow there, with its figure
        axes.plot(highest, place, ">", color=style.color, ms=5, clip_on=False)
        shift: dict[str, Any] = {"xytext": (-7, 0), "textcoords": "offset points"}
        axes.annotate(f"{value:.3g}", (highest, place), **shift, ha="right", va="center")
        return
    if math.isfinite(estimate.low) and math.isfinite(estimate.high):
        axes.plot([estimate.low, estimate.high], [place, place], color=style.color, lw=1.4)
    face = PAPER if row.hollow else style.color
    marker = style.marker or "o"
    axes.plot(value, place, marker, color=style.color, mfc=face, ms=6, clip_on=False)


def _references(evidence: Evidence) -> list[tuple[str, float]]:
    """(label, per cent of the original's MME) of the references, mean over the streams."""
    true, late = [], []
    for result in {r.case.seed: r for r in evidence.study.results("better")}.values():
        run = evidence.run(result)
        if run.facts is not None:
            true.append(100 * run.facts.mme_floor / run.score.mme_original)
            late.append(100 * run.facts.mme_late / run.score.mme_original)
    names = "reference: true model", "true model, one experiment late"
    found = zip(names, (mean(true).value, mean(late).value), strict=True)
    return [(label, value) for label, value in found if value is not None]


def _every(per_experiment: float) -> str:
    return number(1 / per_experiment) if per_experiment > 0 else "∞"
