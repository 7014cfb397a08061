"""`ldt predict`: free runs of every experiment of a recording, with or without effects."""

from __future__ import annotations

from typing import Any

import click

from ldt_core.base.printable import as_argument
from ldt_core.base.sentences import counted
from ldt_core.cli.options import (
    declared_option,
    diagnosis_option,
    json_option,
    namespace_option,
    out_option,
    parameters,
    warn_of_nothing,
)
from ldt_core.cli.outputs import force_option, replacing
from ldt_core.cli.terminal import echo_result, warn


@click.command("predict", short_help="Predict a recording with the physics alone.")
@click.argument("recording")
@parameters("machine")
@diagnosis_option("The diagnosis.json whose effects are added to the machine.")
@click.option(
    "--effect",
    "own",
    multiple=True,
    metavar="FILE.py:NAME",
    help="Effect of your own that the diagnosis names; can be given several times.",
)
@out_option
@force_option
@declared_option("only")
@namespace_option
@json_option
def command(
    settings: dict[str, Any],
    recording: str,
    diagnosis: str,
    own: tuple[str, ...],
    out: str,
    force: bool,
    only: str,
    namespace: str,
    as_json: bool,
) -> None:
    """Predict RECORDING with the physics of the machine file alone, or with the effects that a
    diagnosis has found, and write the predictions beside the experiments.

    Example: ldt predict bag --machine rotor --with diagnosis/diagnosis.json --out predicted
    """

    from ldt_core.base.metrics import FreeRunError
    from ldt_core.base.stopping import stop_on_signals, until_stopped
    from ldt_core.cli.progress import track
    from ldt_core.machine.machine_file import load_machine
    from ldt_core.models.physics import PhysicsModel
    from ldt_core.recording.bag import read_bag
    from ldt_core.recording.writer import BagWriter

    machine = load_machine(settings["machine"])
    acting, promising = [], None
    if diagnosis:
        from ldt_core.diagnosis.diagnosis import read_diagnosis, read_effects
        from ldt_core.diagnosis.fitted_along import check_possible
        from ldt_core.diagnosis.promise import Promising
        from ldt_core.effects import get_effect

        known = [get_effect(name) for name in own]
        acting = read_effects(diagnosis, machine, known)
        found = read_diagnosis(diagnosis, machine)
        check_possible(diagnosis, found, machine, acting)
        if acting:
            promising = Promising(machine, found, known, diagnosis)
        warn_of_nothing(diagnosis, acting)
    model, alone = PhysicsModel(machine, effects=acting), PhysicsModel(machine)
    error, without = FreeRunError(), FreeRunError()
    played = read_bag(recording, namespace, only=only)
    with (
        stop_on_signals() as stop,
        replacing(out, force, [recording]),
        BagWriter(out, namespace=namespace, machine=machine.name) as writer,
    ):
        for experiment in until_stopped(track(played.experiments(machine), "predicting"), stop):
            prediction = model.predict(experiment)
            writer.write("experiment", experiment, experiment.end)
            writer.write("prediction", prediction, experiment.end)
            error.add(prediction.residual(experiment))
            if promising is not None:
                nominal = alone.predict(experiment)
                promising.add(experiment, prediction.speed, nominal.speed)
                without.add(nominal.residual(experiment))
    warn(*played.notes)
    if acting and error.rmse > without.rmse:
        warn(
            f"the diagnosed effects make this prediction worse: without them the root mean square "
            f"error is {without.rmse:.4g} rad/s. What a recording cannot tell apart may differ in "
            "another: diagnose this one as well"
        )
    promise = promising.promise() if promising is not None else None
    told = {} if promise is None else {"promise": promise.as_dict()}
    echo_result(
        as_json,
        {**error.as_dict(), "recording": out, **told},
        f"{counted(error.experiments, 'experiment')}, "
        f"root mean square error {error.rmse:.4g} rad/s, "
        f"mean maximum error {error.mean_max_error:.4g} rad/s: {out}",
        *([] if promise is None else [promise.sentence]),
        f"Next, a picture: ldt plot {as_argument(out)} -o FILE.png",
    )
