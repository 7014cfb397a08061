"""`ldt advise`: what the people at a machine had better do, and not do."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from ldt_core.base.printable import one_line
from ldt_core.cli.options import diagnosis_option, json_option, namespace_option, parameters
from ldt_core.cli.outputs import check_file, force_option
from ldt_core.cli.terminal import echo_result, warn

if TYPE_CHECKING:
    from ldt_core.base.experiment import DiagnosisRecord, Experiment, ModelRecord


@click.command("advise", short_help="Voltages to avoid, margins, and the next experiment.")
@click.argument("recording", required=False)
@parameters("machine")
@diagnosis_option("The diagnosis.json whose effects the machine has.")
@click.option(
    "--effect",
    "given",
    multiple=True,
    metavar="NAME:PARAM=VALUE",
    help="Effect that the machine has in addition to its file; can be given several times.",
)
@click.option(
    "--reach",
    "speed",
    type=click.FLOAT,
    help="Speed to reach from rest [rad/s]; says how to reach it.",
)
@click.option(
    "-o",
    "--out",
    default="",
    metavar="FILE.png",
    help="Picture of the way to the speed of --reach (.png, .svg, .pdf).",
)
@force_option
@namespace_option
@json_option
def command(
    settings: dict[str, Any],
    recording: str | None,
    diagnosis: str,
    given: tuple[str, ...],
    speed: float | None,
    out: str,
    force: bool,
    namespace: str,
    as_json: bool,
) -> None:
    """Show voltages to avoid, margins, and the next experiment, for the machine as it is known.

    The knowledge comes from RECORDING of a run (its last model and diagnosis), from a diagnosis, or
    from effects that you name.

    Example: ldt advise --machine rotor --effect unbalance:e=0.008 --reach 40
    """
    from ldt_core.advice.advise import advise
    from ldt_core.advice.machine_estimate import estimate_machine, with_effects
    from ldt_core.advice.run_up import plan_run_up
    from ldt_core.base.errors import OptionError
    from ldt_core.base.sentences import listed, spoken
    from ldt_core.diagnosis.diagnosis import read_effects
    from ldt_core.effects import parse_effect, refuse_repeated
    from ldt_core.machine.machine_file import load_machine
    from ldt_core.recording.bag import read_bag
    from ldt_core.twin.advisor import RECENT_EXPERIMENTS

    machine_given = click.get_current_context().get_parameter_source("machine")
    if not (recording or diagnosis or given) and machine_given is not ParameterSource.COMMANDLINE:
        raise OptionError("ldt advise", "a run's recording, or a machine: --machine", "neither")
    if out and speed is None:
        raise OptionError("--out", "--reach SPEED as well, whose way it draws", "none")
    if out:
        check_file(out, force)
    machine = load_machine(settings["machine"])
    experiments: list[Experiment] = []
    model: ModelRecord | None = None
    found: DiagnosisRecord | None = None
    if recording:
        bag = read_bag(recording, namespace)
        experiments = list(deque(bag.experiments(machine), RECENT_EXPERIMENTS))
        warn(*bag.notes)
        model = next(iter(deque(bag.records("model"), 1)), None)
        found = next(iter(deque(bag.records("diagnosis"), 1)), None)
    acting = read_effects(diagnosis, machine) if diagnosis else []
    acting += [parse_effect(text, machine.law) for text in given]
    refuse_repeated(acting)
    if acting:
        model = found = None
        belief = with_effects(machine, acting)
    else:
        belief = estimate_machine(machine, model, found)
    advice = advise(machine, belief, experiments, model, found)
    way = None if speed is None else plan_run_up(machine, belief.values, speed, belief.beside)
    if way is not None and out:
        from ldt_core.views.figures.advice_figure import plot_advice

        plot_advice(machine, belief, way, out, machine.duration)
    record = {
        "experiment": advice.experiment or None,
        "warning": advice.warning,
        "sentence": advice.sentence,
        **advice.values,
        "way": way and {**vars(way), "sentence": way.describe()},
    }
    lines = [one_line(advice.sentence), *([way.describe()] if way else [])]
    if way and belief.foreign:
        lines.append(f"Not counted in: {listed(map(spoken, belief.foreign))}.")
    echo_result(as_json, record, *lines)
