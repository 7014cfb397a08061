"""`ldt identify`: a machine file for a machine of which no physics is known."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from ldt_core.base.errors import LdtError, OptionError
from ldt_core.base.printable import as_argument, one_line
from ldt_core.cli.options import (
    declared_option,
    json_option,
    judged_option,
    namespace_option,
    new_file_option,
)
from ldt_core.cli.outputs import check_file, force_option
from ldt_core.cli.progress import status
from ldt_core.cli.terminal import echo, echo_json

if TYPE_CHECKING:
    from ldt_core.base.experiment import Experiment
    from ldt_core.calibration.identify import EquivalentMotor

#: What helps where the recordings determine no motor.
NEXT = (
    "next: record experiments whose voltage steps up and down and waits until the speed settles, "
    "or begin with the data sheet's numbers and ldt calibrate (ldt docs connect)"
)


def _range(
    _context: click.Context, _option: click.Parameter, text: str | None
) -> tuple[float, float] | None:
    if text is None:
        return None
    try:
        low, high = (float(end) for end in text.split(","))
    except ValueError:
        raise click.BadParameter(f"expected LOWEST,HIGHEST in V, got {text!r}") from None
    return low, high


@click.command("identify", short_help="A machine file for a machine of unknown physics.")
@click.argument("recordings", nargs=-1, required=True)
@new_file_option
@force_option
@click.option(
    "--name", help="Name of the machine; by default the recorded one, or that of the file."
)
@click.option(
    "--order",
    type=click.IntRange(0, 2),
    default=0,
    help="Number of time constants, 1 or 2; by default as many as the recordings show.",
)
@click.option(
    "--offset/--no-offset",
    default=True,
    help="Whether the steady speed may differ from gain times voltage by an offset. A machine "
    "file cannot contain one; --no-offset finds the motor that is best without it.",
)
@click.option(
    "--limits",
    callback=_range,
    metavar="LOWEST,HIGHEST",
    help="Permitted voltage [V]; by default the recorded range and a fifth more.",
)
@click.option(
    "--effects",
    metavar="NAME,...",
    help="For a machine that is not a plain motor: gravity_imbalance (a pendulum), "
    "coulomb_friction. `ldt calibrate` then fits their torques too.",
)
@judged_option
@declared_option("only")
@namespace_option
@json_option
def command(
    recordings: tuple[str, ...],
    out: str,
    force: bool,
    name: str | None,
    order: int,
    offset: bool,
    limits: tuple[float, float] | None,
    effects: str | None,
    holdout: float | None,
    only: str,
    namespace: str,
    as_json: bool,
) -> None:
    """Find the DC motor that responds to the voltage like the machine in RECORDINGS.

    Voltage and speed alone determine a gain and one or two time constants. The file describes the
    equivalent motor with R = 1 Ohm and b = 0. If no such motor fits, the command says so, and which
    --effects would help, if any.

    Example: ldt identify bag --out unknown.yaml
    """
    from ldt_core.calibration.identify import identify_machine
    from ldt_core.calibration.machine_yaml import write_machine_file
    from ldt_core.cli.recorded_machine import recorded_machine
    from ldt_core.cli.recordings import as_arguments, naming, read_recordings
    from ldt_core.machine.direction_check import swapped

    check_file(out, force)
    if name is None:  # a diagnosis refuses a file of another machine than the recorded one
        name = recorded_machine(recordings[0], namespace) or Path(out).stem
    experiments = read_recordings(recordings, namespace, only=only)
    bags = as_arguments(recordings, only)
    if effects is not None:
        _refuse_idle("--order", "--offset", "--holdout")
        names = [n.strip() for n in effects.split(",")]
        with naming(recordings):
            _with_effects(experiments, names, name, limits, out, as_json)
        if not as_json:
            _next(f"ldt calibrate {bags} --machine {as_argument(out)} --out FILE.yaml")
        return
    try:
        with naming(recordings), status() as tick:
            found = identify_machine(
                experiments,
                name,
                order=order,
                offset=offset,
                limits=limits,
                holdout=holdout,
                tick=tick,
            ).with_recordings(recordings)
    except LdtError as error:
        if error.exit_code != LdtError.exit_code:
            raise
        question, said = swapped(experiments), str(error).replace("RECORDING", bags)
        told = any(words in said for words in ("ldt docs", "--effects", "import again"))
        raise LdtError(said if told and not question else f"{said}; {question or NEXT}") from None
    write_machine_file(found, out, force)
    if as_json:
        machine = found.machine
        record = {"machine": machine.name, "out": out, "parameters": dict(machine.parameters)}
        echo_json({**record, **found.as_dict()})
    else:
        _print(found, out, bags)
        if found.changed:
            play = f"ldt run --play {as_argument(recordings[0])} --machine {as_argument(out)}"
            _next(f"{play} --diagnose --out played", ", find what changed, and when")
            return
        _next(
            f"ldt diagnose {bags} --machine {as_argument(out)} --out why", ", what the motor lacks"
        )


def _refuse_idle(*options: str) -> None:
    """Refuse options that have no effect with --effects."""
    context = click.get_current_context()
    for option in options:
        given = context.get_parameter_source(option.strip("-"))
        if given is ParameterSource.COMMANDLINE:
            raise OptionError(
                option, "to be left out: it has no effect with --effects", "--effects"
            )


def _with_effects(
    experiments: Sequence[Experiment],
    names: Sequence[str],
    name: str,
    limits: tuple[float, float] | None,
    out: str,
    as_json: bool,
) -> None:
    """Write the file of a motor with these effects, by the balance of its accelerations."""
    import numpy as np

    from ldt_core.base import result_files
    from ldt_core.base.experiment import rms
    from ldt_core.calibration.calibration import free_run_error, limits_note
    from ldt_core.calibration.torque_balance import CONVENTION, balanced_machine
    from ldt_core.recording.messages import dump

    machine = balanced_machine(experiments, names, name, limits)
    rmse = free_run_error(machine, experiments).rmse
    speed = np.concatenate([e.speed for e in experiments])
    still = rms(speed - speed.mean())
    result_files.write(Path(out), dump(machine.as_dict()))
    if as_json:
        echo_json({"machine": name, "out": out, **machine.as_dict(), "rmse": rmse})
        return
    echo(f"free-run error: {rmse:.4g} rad/s, by accelerations alone")
    echo(f"- {CONVENTION}")
    if rmse > still:
        echo(
            f"- Beware: a constant speed leaves less, {still:.4g} rad/s. This is hardly the "
            "machine; look at its figures before you continue with `ldt calibrate`."
        )
    if limits is None:
        echo(f"- {limits_note(machine)}")
    echo(f"machine file: {out}")


def _next(command: str, words: str = "") -> None:
    echo(one_line(f"Next{words}: {command}"))


def _print(found: EquivalentMotor, out: str, bags: str) -> None:
    form = found.form
    names = ["tau_m", "tau_e"] if form.oscillates else ["time constant", "and"]
    times = (f"{n} {t:.4g} s" for n, t in zip(names, form.time_constants, strict=False))
    echo(f"gain {form.gain:.5g} rad/s per V, {' '.join(times)}")
    units = {p.name: p.unit for p in found.machine.model.parameters}
    values = (f"{n} {v:.5g} {units[n]}" for n, v in found.machine.parameters.items())
    echo(f"equivalent motor: {', '.join(values)}")
    for part, error in found.errors.items():
        where = {"fit": "fitted", "held_out": "held out"}[part]
        count, linear = len(found.experiments[part]), found.linear_errors[part]
        echo(
            f"free-run error on {count} experiment{'s' if count > 1 else ''} {where}: "
            f"{error.rmse:.4g} rad/s, mean maximum {error.mean_max_error:.4g} (linear model of "
            f"order {found.linear.order} with an offset: {linear.rmse:.4g} rad/s)"
        )
    for note in found.notes:
        echo(one_line(f"- {note.replace('RECORDING', bags)}"))
    echo(f"machine file: {out}")
