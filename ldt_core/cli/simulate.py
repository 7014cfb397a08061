"""`ldt simulate`: a recording of the simulated machine."""

from __future__ import annotations

from typing import Any

import click

from ldt_core.base.sentences import counted
from ldt_core.cli.options import Command, declared_option, json_option, out_option, parameters
from ldt_core.cli.outputs import force_option, replacing
from ldt_core.cli.terminal import echo_result


@click.command(
    "simulate", cls=Command, short_help="Record a simulated machine, with effects if wanted."
)
@parameters("machine", "run", "plant")
@click.option(
    "--next",
    "designed",
    default="",
    metavar="FILE",
    help="The diagnosis.json whose proposed next experiment is run, with its voltage and channels.",
)
@out_option
@force_option
@declared_option("namespace")
@json_option
def command(
    settings: dict[str, Any], designed: str, out: str, force: bool, namespace: str, as_json: bool
) -> None:
    """Write the experiments of a simulated machine, with effects that its file does not contain.

    The machine does not wear unless --degradation is given.

    Example: ldt simulate --machine rotor --experiments 20 --effect unbalance:e=0.005 --out bag
    """
    from ldt_core.base.stopping import stop_on_signals, until_stopped
    from ldt_core.cli.progress import track
    from ldt_core.machine import Plant
    from ldt_core.machine.excitation import Given
    from ldt_core.machine.machine_file import load_machine
    from ldt_core.recording.writer import BagWriter
    from ldt_core.security.permissions import check_namespace

    check_namespace(namespace)
    machine = load_machine(settings["machine"])
    settings = {**settings, "degradation": settings["degradation"] or "none"}
    if designed:
        from ldt_core.diagnosis.diagnosis import read_next

        machine, volts, current = read_next(designed, machine)
        settings = {**settings, "measure_current": settings["measure_current"] or current}
    plant = Plant.from_settings(machine, settings)
    if designed:
        plant.excitation = Given(volts)
    with (
        stop_on_signals() as stop,
        replacing(out, force, [designed]),
        BagWriter(out, namespace=namespace, machine=machine.name) as writer,
    ):
        numbers = track(range(1, settings["experiments"] + 1), "simulating")
        for number in until_stopped(numbers, stop):
            experiment = plant.experiment(number)
            writer.write("experiment", experiment, experiment.end)
    record = {
        "machine": machine.name,
        "experiments": settings["experiments"],
        "samples": machine.samples,
        "simulated": plant.describe(),
        "recording": out,
    }
    echo_result(
        as_json,
        record,
        f"{counted(settings['experiments'], 'experiment')} of {machine.samples} samples "
        f"({', '.join(plant.describe())}): {out}",
    )
