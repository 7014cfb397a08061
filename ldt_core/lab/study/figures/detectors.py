"""Each detector beside chance: never, and as many alarms by the calendar or at random."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ldt_core.lab.study.figures.dots import Dots, Panel, dot_plot, key_to_marks
from ldt_core.lab.study.figures.reading import Reading
from ldt_core.views.page.style import Drawing, Layout, pair

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Figure of `Score` → panel.
PANELS = (
    Panel("mme", "MME [rad/s]"),
    Panel("recall", "recall", (0, 1)),
    Panel("precision", "precision", (0, 1)),
    Panel("recall_detectable", "recall of detectable drifts", (0, 1)),
    Panel("delay", "experiments to detection", (1, 5)),
    Panel("false_alarm_rate", "false alarms an experiment", (0, 1)),
)
GROUPS = {"paper": "as in the paper", "better": "beyond the paper"}


def beside_chance(reading: Reading) -> Drawing | None:
    """All pairs of model and detector; None without runs of them."""
    rows = _rows(reading)
    known = [p for p in PANELS if any(p.key in row.values for row in rows)]
    if not known:
        return None

    def draw(layout: Layout) -> Figure:
        figure = dot_plot(layout, rows, known, columns=3)
        key_to_marks(figure, layout, baselines=True)
        return figure

    return Drawing(
        "detectors",
        "Each detector beside chance",
        f"{_finding(rows)} Delay and false alarms: a positive within five experiments of a drift "
        "counts for it (1: in its first), any other is a false alarm.",
        "Rows of dots with intervals for every pair of model and detector, beside hollow marks "
        "for never, periodic and random alarms.",
        draw,
    )


def _rows(reading: Reading) -> list[Dots]:
    rows = []
    for group, heading in GROUPS.items():
        pairs = reading.study.pairs(group)
        if pairs:
            rows.append(Dots(heading))
        for model, detector in pairs:
            results = reading.study.results(group, model=model, detector=detector)
            values = {p.key: reading.of(results, p.key) for p in PANELS}
            values = {k: v for k, v in values.items() if v.value is not None}
            by_panel = {k: reading.beside(results, k) for k in values}
            names = {n for found in by_panel.values() for n in found}
            beside = {
                n: {k: found[n] for k, found in by_panel.items() if n in found}
                for n in sorted(names)
            }
            never = beside.get("never", {})
            beside["never"] = {k: v for k, v in never.items() if k == "mme"}
            rows.append(Dots(pair(model, detector), model, values, beside))
    return rows


def _finding(rows: list[Dots]) -> str:
    better, compared = 0, 0
    for row in rows:
        chance = [row.beside[n] for n in ("periodic", "random") if n in row.beside]
        others = [c["mme"].low for c in chance if "mme" in c]
        if others:
            compared += 1
            better += row.values["mme"].high < min(others)
    if not compared:
        return "No baselines were run, so these figures say nothing of what chance would reach."
    return (
        f"Of {compared} pairs of model and detector, {better} have an MME whose interval lies "
        "below that of periodic and of random alarms with as many adaptations."
    )
