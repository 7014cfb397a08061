"""What commands share that compute much, in parallel, and go on where they were interrupted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Self

import click
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from ldt_core.cli.console import Console
from ldt_core.cli.terminal import echo

jobs_option = click.option(
    "--jobs",
    type=click.IntRange(0, 10_000),
    default=0,
    help="Processes on this machine; by default as many as there are cores.",
)
scheduler_option = click.option(
    "--scheduler",
    default="",
    help="Address of a Dask scheduler (tcp://host:port) whose workers compute instead.",
)


def compute_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """--jobs and --scheduler: where it is computed."""
    return jobs_option(scheduler_option(command))


class ResumableProgress:
    """A progress bar on a terminal's standard error; nothing on a pipe.

    Args:
        work: what goes on, in a word.
        items: what is counted, in the plural.
        out: folder of the results, named when the work is interrupted.
    """

    def __init__(self, work: str, items: str, out: str) -> None:
        self._items, self._out, self._done, self._total = items, out, 0, 0
        console = Console(stderr=True)
        self._progress = Progress(
            TextColumn(work),
            BarColumn(bar_width=40),
            MofNCompleteColumn(),
            TextColumn(items),
            TimeRemainingColumn(compact=True),
            console=console,
            disable=not console.is_terminal,
        )
        self._task = self._progress.add_task("", total=None)

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._progress.stop()
        if kind is KeyboardInterrupt and self._done:
            kept = f"{self._done} of {self._total} {self._items} are kept in {self._out}"
            echo(f"{kept}; the same command goes on from there", err=True)

    def show(self, done: int, total: int) -> None:
        """Items that are there, and how many there will be as far as is known."""
        self._done, self._total = done, total
        self._progress.update(self._task, completed=done, total=total)
