"""What commands that work on whole recordings have in common: reading them, saying what goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

from ldt_core.cli.console import Console
from ldt_core.cli.terminal import echo, one_line

if TYPE_CHECKING:
    from ldt_core.base.experiment import Experiment
    from ldt_core.machine.machine_file import Machine

new_file_option = click.option("-o", "--out", required=True, help="Machine file to write.")
force_option = click.option(
    "--force", is_flag=True, help="Overwrite the machine file if it exists."
)
judged_option = click.option(
    "--holdout",
    type=float,
    metavar="FRACTION",
    help="Share of the experiments to judge by, not to fit (a quarter when there are 4 or more).",
)


def read_recordings(
    recordings: Sequence[str], namespace: str, machine: Machine | None = None
) -> list[Experiment]:
    """Experiments of all recordings; what is odd goes to stderr.

    Args:
        recordings: folders or files; those of several are numbered on from one to the next.
        namespace: machine whose topics are meant.
        machine: whose limits the experiments must keep; None when it is not known.

    Raises:
        RecordingError: a recording that cannot be read.
        ExperimentError: an experiment outside the machine's limits.
    """
    from dataclasses import replace

    from ldt_core.recording.bag import read_bag

    found: list[Experiment] = []
    for recording in recordings:
        bag = read_bag(recording, namespace)
        for experiment in bag.experiments(machine):
            numbered = len(recordings) > 1
            found.append(replace(experiment, number=len(found) + 1) if numbered else experiment)
        for note in bag.notes:
            echo(one_line(note), err=True)
    return found


@contextmanager
def progress(words: str = "{}") -> Iterator[Callable[[str], None]]:
    """What is being done, on a terminal's standard error; nothing on a pipe.

    Args:
        words: what to show of what is being done and of how often it was said.
    """
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda doing: None
        return
    with console.status("reading") as status:
        count = 0

        def tick(doing: str) -> None:
            nonlocal count
            count += 1
            status.update(words.format(doing, count))

        yield tick
