"""Detectors beside never, periodic and random alarms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ldt_core.lab.study.case import Result
from ldt_core.lab.study.cell import cell
from ldt_core.lab.study.figures.reading import Reading
from ldt_core.views.page.blocks import Folded, Section, Table, Text, Value
from ldt_core.views.page.style import Drawing, pair

GROUPS = ("paper", "better")
COLUMNS = {
    "MME [rad/s]": "mme",
    "adaptations": "adaptations",
    "recall": "recall",
    "precision": "precision",
    "recall of detectable": "recall_detectable",
    "delay": "delay",
    "false alarm rate": "false_alarm_rate",
}


def chance(reading: Reading, drawings: Mapping[str, Drawing | None]) -> Section:
    """The figure, and its figures in a table."""
    section = Section("chance", "Detectors beside chance")
    section.blocks.append(
        Text(
            "A score says something only beside what chance reaches: the original model that never "
            "learns, and alarms by the calendar (periodic) and drawn at random, on the same "
            "streams, as many as the run beside them has adaptations. Recall over detectable "
            "drifts leaves out those that the noise hides from any observer of one experiment."
        )
    )
    section.figure(drawings["detectors"], "This study has no runs for it.")
    rows = [row for group in GROUPS for row in _rows(reading, group)]
    if rows:
        table = Table(
            "Mean over seeds, 95 % confidence interval below it",
            ("run", *COLUMNS),
            rows,
            range(1, 1 + len(COLUMNS)),
        )
        section.blocks.append(Folded("The same in figures", table))
    return section


def _rows(reading: Reading, group: str) -> list[Sequence[Value]]:
    rows: list[Sequence[Value]] = []
    for model, detector in reading.study.pairs(group):
        results = reading.study.results(group, model=model, detector=detector)
        name = pair(model, detector) + ("" if group == "paper" else " (beyond)")
        rows.append([name, *(cell(reading.of(results, f)) for f in COLUMNS.values())])
        rows += _beside(reading, results)
    return rows


def _beside(reading: Reading, results: Sequence[Result]) -> list[Sequence[Value]]:
    by_figure = {f: reading.beside(results, f) for f in COLUMNS.values()}
    names = [n for n in ("periodic", "random") if n in by_figure["mme"]]
    return [[f"… {n} alarms", *(cell(by_figure[f][n]) for f in COLUMNS.values())] for n in names]
