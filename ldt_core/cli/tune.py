"""`ldt tune`: detector and threshold for a stated budget, chosen from a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ldt_core.cli.options import (
    Command,
    compute_options,
    declared_option,
    json_option,
    namespace_option,
    parameters,
)
from ldt_core.cli.outputs import check_results, force_option, no_empty_folder
from ldt_core.cli.spelling import SuggestingChoice
from ldt_core.cli.terminal import echo, echo_json, warn

if TYPE_CHECKING:
    from ldt_core.lab.tuning.tune import Tuning

#: As `ldt_core.lab.tuning.candidates.TUNED`, whose import takes a second.
DETECTORS = ("threshold", "lddm", "window", "adequacy")


@click.command(
    "tune", cls=Command, short_help="Choose a detector and its threshold for a recording."
)
@click.argument("recording")
@click.option(
    "--adaptations",
    type=click.IntRange(1, 1_000_000),
    help="Budget: at most this many adaptations over this recording.",
)
@click.option(
    "--false-alarms-every",
    type=click.FloatRange(2.0, 1e9),
    help="Budget: at most one false alarm in this many experiments of the unchanged machine.",
)
@click.option(
    "--in-control",
    default="",
    metavar="RANGES",
    help="Experiments in which the machine had not changed, as 1:20 or 1:20,60:80; by default the "
    "longest stretch that the model explains, as the adequacy detector judges.",
)
@click.option(
    "--detector",
    "detectors",
    type=SuggestingChoice(DETECTORS),
    multiple=True,
    help="Detector to choose from; can be given several times; by default all.",
)
@click.option(
    "--values",
    type=click.IntRange(2, 1000),
    default=8,
    show_default=True,
    help="Values of each detector that are tried at first; a second round refines the best.",
)
@click.option(
    "-o", "--out", required=True, help="Folder of the result; an earlier one is continued."
)
@force_option
@compute_options
@declared_option("only")
@namespace_option
@json_option
@parameters("machine", "model", "adaptor")
def command(
    settings: dict[str, Any],
    recording: str,
    adaptations: int | None,
    false_alarms_every: float | None,
    in_control: str,
    detectors: tuple[str, ...],
    values: int,
    out: str,
    force: bool,
    jobs: int,
    scheduler: str,
    only: str,
    namespace: str,
    as_json: bool,
) -> None:
    """Choose the best detector and threshold for RECORDING within a budget.

    Plays the recording through the twin with many settings, and chooses the one with the smallest
    error within the budget. Writes tune.json (for --settings of other commands), tune.csv, and the
    trade-off as tradeoff.png and .svg. If interrupted, run the same command again to continue.
    Results of another recording are not replaced.

    Example: ldt tune my_run --adaptations 20 --model linear --out tuned
    """
    from ldt_core.base.errors import LdtError
    from ldt_core.base.settings import resolve
    from ldt_core.cli.progress import ResumableProgress
    from ldt_core.lab.tuning.choice import Budget
    from ldt_core.lab.tuning.tune import tune
    from ldt_core.lab.tuning.tune_files import (
        FILE,
        TABLE,
        choice_sentence,
        is_of,
        tuning_record,
        write_results,
    )
    from ldt_core.lab.tuning.tuning_figure import write_figure
    from ldt_core.machine.machine_file import load_machine
    from ldt_core.recording.bag import read_bag
    from ldt_core.recording.held_samples import HeldSamples
    from ldt_core.views.page import style

    style.require()
    budget = Budget(adaptations, false_alarms_every)
    bag = read_bag(recording, namespace, only=only)

    def begins(matter: str) -> None:
        if not is_of(out, matter):
            check_results(out, (FILE, TABLE), force)

    with no_empty_folder(out), ResumableProgress("tuning", "settings", out) as progress:
        found = tune(
            load_machine(settings["machine"]),
            resolve(settings),
            HeldSamples().of(bag),
            budget,
            out,
            in_control=in_control,
            detectors=detectors or DETECTORS,
            values=values,
            jobs=jobs,
            scheduler=scheduler,
            source=recording,
            begins=begins,
            progress=progress.show,
        )
    write_results(found, out)
    pictures = write_figure(found, out)
    warn(*bag.notes, *found.notes)
    if as_json:
        record = {**tuning_record(found), "out": out, "figure": str(pictures[0])}
        echo_json(record)
    if found.choice.chosen is None:
        raise LdtError(choice_sentence(found))
    if not as_json:
        _print(found, out)


def _print(found: Tuning, out: str) -> None:
    from ldt_core.lab.tuning.tune_files import choice_sentence, why

    assert found.choice.chosen is not None
    echo(choice_sentence(found))
    for reason in why(found):
        echo(f"- {reason}")
    echo(f"options: {found.choice.chosen.setting.options}")
    echo(f"for other commands: --settings {out}/tune.json")
    echo(f"all that was tried: {out}/tune.csv, {out}/tradeoff.png")
