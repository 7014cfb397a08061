"""What a run shows when it has ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table

from ldt_core.base.metrics import Summary
from ldt_core.cli.console import Console
from ldt_core.cli.terminal import echo_json, one_line

MAX_DIAGNOSES = 5  # shown when a run has ended, the last ones; the recording has all
MAX_COLUMNS = 3  # machines in the table that a run ends with; more are a row each


def print_summaries(
    runs: Sequence[tuple[str, Summary, str]], settings: Mapping[str, Any], as_json: bool
) -> None:
    """The table that a run ends with, on standard output.

    Args:
        runs: (machine, what happened, where the recording is), one a machine.
        settings: of the run.
        as_json: one JSON object instead of the table.
    """
    if as_json:
        listed = [{"machine": m, **s.as_dict(), "recording": bag or None} for m, s, bag in runs]
        echo_json({"settings": dict(settings), "runs": listed})
        return
    console = Console()
    title = one_line(f"{settings['model']} model, {settings['detector']} detector")
    console.print(_table(title, {machine: summary for machine, summary, _ in runs}))
    for machine, summary, bag in runs:
        shown = summary.diagnoses[-MAX_DIAGNOSES:]
        told = [f"diagnosis at experiment {d.experiment}: {d.sentence}" for d in shown]
        lines = [f"{machine}, {words}" for words in told]
        if (before := len(summary.diagnoses) - MAX_DIAGNOSES) > 0:
            lines.append(f"{machine}: {before} earlier diagnoses")
        if (a := summary.advice) is not None:
            lines.append(f"{machine}, advice at experiment {a.experiment}: {a.sentence}")
        for line in [*lines, *(f"{machine}: {note}" for note in summary.notes)]:
            console.print(one_line(line))
        if bag and Path(bag).exists():
            console.print(f"recording: {bag}")


def _table(title: str, summaries: Mapping[str, Summary]) -> Table:
    """What happened, by machine: side by side while there is room, else one below the other."""
    table = Table(title=title)
    if len(summaries) <= MAX_COLUMNS:
        table.add_column("")
        for machine in summaries:
            table.add_column(one_line(machine), justify="right")
        columns = [dict(s.rows()) for s in summaries.values()]
        for label in dict.fromkeys(label for column in columns for label in column):
            table.add_row(label, *(c.get(label, "0") for c in columns))
        return table
    table.box, table.padding, table.pad_edge = SIMPLE_HEAD, (0, 1, 0, 0), False
    table.add_column("", no_wrap=True)
    for label in Summary().cells():
        table.add_column(label, justify="right", no_wrap=True)
    for machine, summary in summaries.items():
        table.add_row(one_line(machine), *summary.cells().values())
    return table
