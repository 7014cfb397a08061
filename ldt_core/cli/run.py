"""`ldt run`: the loop without ROS."""

from __future__ import annotations

from functools import partial
from typing import Any

import click

from ldt_core.cli.display import RunProgress, print_summaries
from ldt_core.cli.options import json_option, parameters


@click.command("run")
@parameters("machine", "plant", "run", "model", "detector", "adaptor", "player", "pace", "recorder")
@click.option("--no-bag", is_flag=True, help="Record nothing.")
@json_option
def command(settings: dict[str, Any], no_bag: bool, as_json: bool) -> None:
    """Run the same loop as `ldt up` without ROS: same options, same numbers.

    Example: ldt run --experiments 40 --seed 3 --model linear
    """
    from ldt_core import session
    from ldt_core.machine import load_machine
    from ldt_core.pace import paced, parse_rate
    from ldt_core.plant import Plant
    from ldt_core.recording.bag import read_bag

    machine = load_machine(settings["machine"])
    rate = 1.0 if settings["real_time"] else parse_rate(settings["rate"])
    if settings["play"]:
        played = read_bag(settings["play"], settings["play_namespace"])
        experiments, total = played.experiments(), None
    else:
        plant = Plant.from_settings(machine, settings)
        total = settings["experiments"]
        experiments = (plant.experiment(number) for number in range(1, total + 1))
    bag = None if no_bag else settings["bag"] or session.new_recording(machine.name)
    with RunProgress({machine.name: total}) as progress:
        summary = session.run(
            machine,
            settings,
            paced(experiments, rate),
            bag,
            partial(progress.show_step, machine.name),
        )
    if settings["play"]:
        summary.note(*played.notes)
    print_summaries([(machine.name, summary, str(bag or ""))], settings, as_json)
