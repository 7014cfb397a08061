"""How far the work is, and the table that a run ends with.

On a terminal it is a bar on standard error; on a pipe or in a log a line there now and then.
"""

from __future__ import annotations

import functools
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.progress import track as _track
from rich.table import Table

from ldt_core.base.errors import LdtError
from ldt_core.base.printable import as_argument, one_line
from ldt_core.base.stopping import Interrupted
from ldt_core.cli.console import Console
from ldt_core.cli.terminal import echo, echo_json, warn

if TYPE_CHECKING:  # with its arrays it takes longer to load than all of the help
    from ldt_core.base.experiment import Adaptation, Signal, Step
    from ldt_core.base.metrics import Summary

Item = TypeVar("Item")

#: Tone of a state → colour of a terminal.
COLOURS = {"good": "green", "found": "cyan", "bad": "red", "vague": "yellow", "open": "dim"}
MAX_DIAGNOSES = 5  # shown when a run has ended, the last ones; the recording has all
MAX_FAILURES = 3  # told in the sentence that a run fails with; --json has more
MAX_COLUMNS = 3  # machines in the table that a run ends with; more are a row each


MINUTE = 60.0  # s
LINE_EVERY = 30.0  # s between two lines on a pipe: a log of an hour has 120, a quick command none
LIVE_LINE_EVERY = 3600.0  # s, the same where there is no end: what happens has lines of its own
MOST_CHANGES = 10  # of a live machine that are told in a row: those of its first minutes
CHANGE_EVERY = 360.0  # s after which another one may be: no log is filled by a restless machine
# Items, or a quarter of them if that is less, before the time left is told: a mean of ten is known
# within a third of an item's own spread. The first one of a fresh installation also compiles.
TIMED = 10


class _Lines:
    """Lines on a pipe's standard error, none oftener than each `LINE_EVERY`.

    Args:
        live: there is no end; they come ever more rarely, to once in `LIVE_LINE_EVERY`.
    """

    def __init__(self, live: bool = False) -> None:
        self._live, self._every = live, LINE_EVERY
        self._piped = not sys.stderr.isatty()
        self._told = time.monotonic()
        self._first: tuple[float, int] | None = None  # when the first were done, and how many

    def tell(self, words: Callable[[], str], done: int = 0, total: int | None = None) -> None:
        """Print them if it is time, and how long it will take yet where that is known."""
        now = time.monotonic()
        since, before = self._first = self._first or (now, done)
        if self._piped and now - self._told >= self._every:
            self._told = now
            if self._live:
                self._every = min(2 * self._every, LIVE_LINE_EVERY)
            timed = done - before
            known = total is not None and timed >= max(1, min(TIMED, total / 4))
            left = (now - since) * (total - done) / timed if total and known else 0
            echo(one_line(words() + (f", about {_span(left)} left" if left else "")), err=True)


class _Changes:
    """Which changes of a live machine are told, and how many were not."""

    def __init__(self) -> None:
        self._left, self._since = float(MOST_CHANGES), time.monotonic()
        self._untold = 0

    def told(self) -> bool:
        """Whether the one that has come is told; it is counted if not."""
        now = time.monotonic()
        self._left = min(self._left + (now - self._since) / CHANGE_EVERY, MOST_CHANGES)
        self._since = now
        told = self._left >= 1
        self._left -= told
        self._untold += not told
        return told

    def untold(self) -> str:
        """How many were not since the last line."""
        count, self._untold = self._untold, 0
        return f" ({count} more changes in between; ldt watch shows all)" if count else ""


def _span(seconds: float) -> str:
    """A time that is left, roughly.

    >>> _span(12.3), _span(4000)
    ('12 s', '67 min')
    """
    return f"{seconds:.0f} s" if seconds < 2 * MINUTE else f"{seconds / MINUTE:.0f} min"


def _of(done: int, total: int | None) -> str:
    return f"{done}" if total is None else f"{done} of {total}"


def _progress(*columns: ProgressColumn) -> Progress:
    console = Console(stderr=True, soft_wrap=False)
    remaining = TimeRemainingColumn(compact=True)
    return Progress(*columns, remaining, console=console, disable=not console.is_terminal)


class RunProgress:
    """One progress bar a machine.

    Args:
        totals: machine → number of experiments, None when it is not known.
        live: it stays beside a machine without an end: what changes has a line, with the date.
        resumed: experiments count from 1, and the first ones are not shown.
    """

    def __init__(
        self, totals: Mapping[str, int | None], live: bool = False, resumed: bool = False
    ) -> None:
        self._live, self._resumed = live, resumed
        self._progress = _progress(
            TextColumn("{task.fields[machine]}"),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TextColumn("{task.description}"),
        )
        self._tasks = {
            machine: self._progress.add_task(
                "starting", total=total, machine=escape(one_line(machine))
            )
            for machine, total in totals.items()
        }
        self._lines, self._totals = _Lines(live), dict(totals)
        self._done = dict.fromkeys(totals, 0)
        self._changed = dict.fromkeys(totals, False)
        self._changes = _Changes()

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
        from ldt_core.base.model_state import shown_state, times_noise

        state, beside = shown_state(signal), times_noise(signal.adequacy)
        words = (
            f"max error {signal.max_error:7.3f} rad/s  "
            f"[{COLOURS[state.tone]}]{state.brief:19}[/]  "
            f"{beside:20}  model {adaptation.model_version}"
        )
        if self._resumed and not self._done[machine]:
            self._done[machine] = signal.experiment - 1
        self._done[machine] += 1
        done = self._done[machine]
        self._progress.update(self._tasks[machine], completed=done, description=words)

        def line() -> str:
            return (
                f"{self._now()}{machine}: experiment {_of(done, self._totals[machine])}, "
                f"{state.brief}, max error {signal.max_error:.3g} rad/s, "
                f"model {adaptation.model_version}{self._changes.untold()}"
            )

        before, self._changed[machine] = self._changed[machine], state.name == "changed"
        adapted = adaptation.action == "adapted"
        changed = adapted or (self._changed[machine] and not before)
        if self._live and changed and self._changes.told():
            self._print(line() + (f": {adaptation.reason}" if adapted else ""))
        else:
            self._lines.tell(line, done, self._totals[machine])

    def warn(self, machine: str, words: str) -> None:
        """What a person should look at, above the bars."""
        self._print(f"{self._now()}{machine}, {words}")

    def _print(self, line: str) -> None:
        self._progress.console.print(escape(one_line(line)), soft_wrap=True)

    def _now(self) -> str:
        return time.strftime("%Y-%m-%d %H:%M:%S ") if self._live else ""


class ResumableProgress:
    """The progress of work that the same command continues where it was interrupted."""

    def __init__(self, work: str, items: str, out: str) -> None:
        self._items, self._out, self._done, self._total = items, out, 0, 0
        self._work, self._lines = work, _Lines()
        bar, count = BarColumn(bar_width=40), MofNCompleteColumn()
        self._progress = _progress(TextColumn(work), bar, count, TextColumn(items))
        self._task = self._progress.add_task("", total=None)

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._progress.stop()
        if kind is KeyboardInterrupt and self._done:
            kept = f"{self._done} of {self._total} {self._items}, which are kept in {self._out}"
            raise Interrupted(kept) from None

    def show(self, done: int, total: int) -> None:
        """Items that are there, and how many there will be as far as is known."""
        self._done, self._total = done, total
        self._progress.update(self._task, completed=done, total=total)
        self._lines.tell(lambda: f"{self._work}: {done} of {total} {self._items}", done, total)


def track(items: Iterable[Item], what: str, total: int | None = None) -> Iterator[Item]:
    """The items, with a progress bar; `total` where they do not know their number."""
    console = Console(stderr=True, soft_wrap=False)
    disable = not console.is_terminal
    bar = _track(items, what, total, console=console, disable=disable, transient=True)
    lines = _Lines()
    many = len(items) if total is None and isinstance(items, Sized) else total
    for done, item in enumerate(bar, start=1):
        lines.tell(lambda done=done: f"{what}: {_of(done, many)}", done, many)  # type: ignore[misc]
        yield item


@contextmanager
def status(words: str = "{}") -> Iterator[Callable[[str], None]]:
    """What is being done, in a line.

    Args:
        words: what to show of what is being done and of how often it was said.
    """
    console = Console(stderr=True, soft_wrap=False)
    lines, count = _Lines(), 0
    with console.status("reading") if console.is_terminal else nullcontext() as line:

        def tick(doing: str) -> None:
            nonlocal count
            count += 1
            told = words.format(doing, count)
            if line is None:
                lines.tell(lambda: told)
            else:
                line.update(told)

        yield tick


@functools.cache
def _compiling_lines() -> _Lines:
    return _Lines()


def show_compiling(ready: int) -> None:
    """Say once that code is compiled, then now and then how many functions are ready."""
    lines = _compiling_lines()
    if ready == 1:
        warn("compiling numerical code that is new on this computer: up to a minute")
    lines.tell(lambda: f"compiling: {ready} functions are ready")


def print_summaries(
    runs: Sequence[tuple[str, Summary, str]], settings: Mapping[str, Any], as_json: bool
) -> None:
    """The table that a run ends with, on standard output.

    Args:
        runs: (machine, what happened, where the recording is), one a machine.
        settings: of the run.
        as_json: one JSON object instead of the table.

    Raises:
        LdtError: an experiment that was sent was not answered, or is not recorded.
    """
    if as_json:
        listed = [{"machine": m, **s.as_dict(), "recording": bag or None} for m, s, bag in runs]
        echo_json({"settings": dict(settings), "runs": listed})
    else:
        _print_table(runs, settings)
    told = [f"{machine}: {words}" for machine, s, _ in runs for words in s.failures]
    if told:
        more = len(told[MAX_FAILURES:]) + sum(s.further_failures for _, s, _ in runs)
        raise LdtError("; ".join(told[:MAX_FAILURES]) + (f"; and {more} more" if more else ""))


def interrupted_run(
    runs: Sequence[tuple[str, Summary, str]], settings: Mapping[str, Any]
) -> KeyboardInterrupt:
    """What to raise behind the summaries of a run that was ended before its time.

    Args:
        runs: as of `print_summaries`.
        settings: of the run.
    """
    from ldt_core.restart.run_key import command_to_resume

    bags = [Path(bag) for _, _, bag in runs if bag]
    if not bags:
        return KeyboardInterrupt()
    done = sum(summary.experiments for _, summary, _ in runs)
    machines = settings.get("machines", 1)
    total = None if settings["play"] else settings["experiments"] * machines
    kept = f"{_of(done, total)} experiments"
    place = bags[0].parent if machines > 1 else bags[0]
    again = command_to_resume(settings, place) if done else "the same command and --force"
    return Interrupted(kept, again)


def _print_table(runs: Sequence[tuple[str, Summary, str]], settings: Mapping[str, Any]) -> None:
    console = Console()
    title = one_line(f"{settings['model']} model, {settings['detector']} detector")
    console.print(_table(title, {machine: summary for machine, summary, _ in runs}))
    for machine, summary, bag in runs:
        shown = summary.diagnoses[-MAX_DIAGNOSES:]
        told = [f"diagnosis at experiment {d.experiment}: {d.sentence}" for d in shown]
        few = len(runs) <= MAX_COLUMNS  # else the table's rows say it
        lines = [f"{machine}: {summary.outcome}"] if few and summary.outcome else []
        lines += [f"{machine}: {summary.learned}"] if few and summary.learned else []
        lines += [f"{machine}, {words}" for words in told]
        if (before := len(summary.diagnoses) - MAX_DIAGNOSES) > 0:
            lines.append(f"{machine}: {before} earlier diagnos{'is' if before == 1 else 'es'}")
        if (a := summary.advice) is not None:
            lines.append(f"{machine}, advice at experiment {a.experiment}: {a.sentence}")
        for line in [*lines, *(f"{machine}: {note}" for note in summary.notes)]:
            console.print(one_line(line))
        if bag and Path(bag).exists():
            console.print(f"recording: {bag}")
    if runs and (bag := runs[0][2]) and Path(bag).exists():
        console.print(f"its page:  ldt report {as_argument(bag)} -o run.html", soft_wrap=True)


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
    for label in next(iter(summaries.values())).cells():
        table.add_column(label, justify="right", no_wrap=True)
    for machine, summary in summaries.items():
        table.add_row(one_line(machine), *summary.cells().values())
    return table
