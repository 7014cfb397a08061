"""`ldt run`: the loop without ROS."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from ldt_core.cli.options import Command, json_option, parameters, preset_option
from ldt_core.cli.outputs import force_option, refuse_force, replacing
from ldt_core.cli.progress import RunProgress, interrupted_run, print_summaries

if TYPE_CHECKING:
    from ldt_core.base.experiment import Experiment
    from ldt_core.base.metrics import Summary
    from ldt_core.base.stopping import Stop
    from ldt_core.machine import Plant


@click.command(
    "run", cls=Command, short_help="The same as up without ROS: same options, same numbers."
)
@parameters(
    *("machine", "plant", "run", "model", "detector", "adaptor", "diagnosis", "advice"),
    *("player", "pace", "twin", "place", "recorder", "graph", "resume"),
)
@force_option
@click.option("--no-bag", is_flag=True, help="Record nothing.")
@preset_option
@json_option
def command(settings: dict[str, Any], force: bool, no_bag: bool, as_json: bool) -> None:
    """Run the same loop as `ldt up` without ROS: same options, same numbers.

    Several machines run one after the other. The loop never waits, so --adaptation-timeout has no
    effect. Ctrl-C stops cleanly after the current experiment, or after 5 s, with exit code 130, and
    prints the command that continues.

    Example: ldt run --experiments 40 --seed 3 --model linear
    """
    from ldt_core.base.errors import BadInput
    from ldt_core.base.stopping import INTERRUPTED, stop_on_signals
    from ldt_core.restart.run_key import resumed

    if settings["resume"]:
        if no_bag:
            raise BadInput(
                "--no-bag", "to be left out with --resume, which goes on recording", "it"
            )
        refuse_force(force)
        settings = resumed(settings)
    place = "" if no_bag or settings["resume"] else settings["bag"]
    with stop_on_signals() as stop, replacing(place, force, [settings["play"]]):
        runs = _conduct(settings, no_bag, stop)
        print_summaries(runs, settings, as_json)
        if any(INTERRUPTED in summary.notes for _, summary, _ in runs):
            raise interrupted_run(runs, settings)


def _simulated(plant: Plant, count: int, after: int) -> Iterator[Experiment]:
    """The plant's experiments behind a number."""
    return map(plant.experiment, range(after + 1, count + 1))


def _conduct(settings: dict[str, Any], no_bag: bool, stop: Stop) -> list[tuple[str, Summary, str]]:
    """Run machine after machine: (name, what happened, where the recording is) of each."""
    from ldt_core.base.metrics import Summary
    from ldt_core.base.stopping import INTERRUPTED
    from ldt_core.machine import Plant
    from ldt_core.machine.machine_file import load_machine
    from ldt_core.recording.bag import read_bag
    from ldt_core.recording.pace import paced, parse_rate
    from ldt_core.restart.run_key import begin_of
    from ldt_core.runs import offline
    from ldt_core.runs.fleet_members import fleet

    machine = load_machine(settings["machine"])
    rate = 1.0 if settings["real_time"] else parse_rate(settings["rate"])
    members = fleet(machine, settings)
    total = None if settings["play"] else settings["experiments"]
    runs = []
    resumed = bool(settings["resume"]) and not settings["play"]
    with RunProgress({m.name: total for m in members}, resumed=resumed) as progress:
        for member in members:
            own = member.settings
            if own["resume"] and not member.bag.exists():  # interrupted before this one's turn
                own = {**own, "resume": ""}
            summary = Summary()
            experiments: Iterable[Experiment] | Callable[[int], Iterable[Experiment]]
            if own["play"]:
                played = read_bag(own["play"], own["play_namespace"], only=own["only"])
                experiments = played.experiments(refused=summary.reject)
            else:
                begin = own["start_time"]
                begin = begin_of(own["bag"], begin) if own["resume"] else begin
                plant = Plant.from_settings(machine, {**own, "start_time": begin})
                experiments = partial(_simulated, plant, own["experiments"])
            offline.run(
                machine,
                own,
                experiments,
                None if no_bag else member.bag,
                partial(progress.show_step, member.name),
                member.namespace,
                lambda ahead: paced(ahead, rate, stop),
                summary,
                stop.in_time,
            )
            if own["play"]:
                summary.note(*played.notes)
            runs.append((member.name, summary, "" if no_bag else str(member.bag)))
            if stop.is_set() and (member != members[-1] or summary.experiments != total):
                summary.note(INTERRUPTED)
                break
    return runs
