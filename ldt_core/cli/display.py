"""What a run shows: a progress bar while it goes, a table when it has ended."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self, TypeVar

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.progress import track as _track
from rich.table import Table

from ldt_core.base.experiment import Adaptation, Level, Signal, Step
from ldt_core.base.metrics import Summary
from ldt_core.cli.console import Console
from ldt_core.cli.terminal import one_line

Item = TypeVar("Item")

DIAGNOSES = 5  # shown when a run has ended, the last ones; the recording has all
SIDE_BY_SIDE = 3  # machines in the table that a run ends with; more are a row each
COLOURS = {Level.NEGATIVE: "green", Level.WARNING: "yellow", Level.POSITIVE: "red"}


class RunProgress:
    """One progress bar a machine, on a terminal's standard error; nothing on a pipe.

    Args:
        totals: machine → number of experiments, None when it is not known.
    """

    def __init__(self, totals: Mapping[str, int | None]) -> None:
        console = Console(stderr=True)
        self._progress = Progress(
            TextColumn("{task.fields[machine]}"),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TextColumn("{task.description}"),
            TimeRemainingColumn(compact=True),
            console=console,
            disable=not console.is_terminal,
        )
        self._tasks = {
            machine: self._progress.add_task("starting", total=total, machine=_name(machine))
            for machine, total in totals.items()
        }

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def show_step(self, machine: str, step: Step) -> None:
        """The step that is done."""
        self.show(machine, step.signal, step.adaptation)

    def show(self, machine: str, signal: Signal, adaptation: Adaptation) -> None:
        """The experiment that is done."""
        words = (
            f"max error {signal.max_error:7.3f} rad/s  "
            f"[{COLOURS[signal.level]}]{signal.level.word:8}[/]  "
            f"model {adaptation.model_version}"
        )
        self._progress.update(self._tasks[machine], advance=1, description=words)


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
        print(json.dumps({"settings": dict(settings), "runs": listed}, allow_nan=False))
        return
    console = Console(soft_wrap=True)
    title = _name(f"{settings['model']} model, {settings['detector']} detector")
    console.print(_table(title, {machine: summary for machine, summary, _ in runs}))
    for machine, summary, bag in runs:
        for d in summary.diagnoses[-DIAGNOSES:]:
            words = f"{machine}, diagnosis at experiment {d.experiment}: {d.sentence}"
            console.print(one_line(words), markup=False, highlight=False)
        if (before := len(summary.diagnoses) - DIAGNOSES) > 0:
            words = f"{machine}: {before} earlier diagnoses"
            console.print(one_line(words), markup=False, highlight=False)
        if (a := summary.advice) is not None:
            words = f"{machine}, advice at experiment {a.experiment}: {a.sentence}"
            console.print(one_line(words), markup=False, highlight=False)
        for note in summary.notes:
            console.print(one_line(f"{machine}: {note}"), markup=False, highlight=False)
        if bag and Path(bag).exists():
            console.print(f"recording: {bag}", markup=False, highlight=False)


def _table(title: str, summaries: Mapping[str, Summary]) -> Table:
    """What happened, by machine: side by side while there is room, else one below the other."""
    table = Table(title=title)
    if len(summaries) <= SIDE_BY_SIDE:
        table.add_column("")
        for machine in summaries:
            table.add_column(_name(machine), justify="right")
        columns = [dict(s.rows()) for s in summaries.values()]
        for label in dict.fromkeys(label for column in columns for label in column):
            table.add_row(escape(label), *(c.get(label, "0") for c in columns))
        return table
    table.box, table.padding, table.pad_edge = SIMPLE_HEAD, (0, 1, 0, 0), False
    table.add_column("", no_wrap=True)
    for label in Summary().cells():
        table.add_column(label, justify="right", no_wrap=True)
    for machine, summary in summaries.items():
        table.add_row(_name(machine), *summary.cells().values())
    return table


def _name(text: str) -> str:
    """A name for rich, which would take square brackets in it for its own."""
    return escape(one_line(text))


def track(items: Iterable[Item], what: str) -> Iterator[Item]:
    """The items, with a progress bar on a terminal's standard error and nothing on a pipe."""
    console = Console(stderr=True)
    yield from _track(items, what, console=console, disable=not console.is_terminal, transient=True)
