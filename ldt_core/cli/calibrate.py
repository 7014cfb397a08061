"""`ldt calibrate`: the parameters of a machine file from recordings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click
from rich.table import Table

from ldt_core.base.errors import OptionError
from ldt_core.base.printable import as_argument, one_line
from ldt_core.base.sentences import counted
from ldt_core.cli.console import Console
from ldt_core.cli.options import (
    declared_option,
    diagnosis_option,
    json_option,
    judged_option,
    namespace_option,
    new_file_option,
    parameters,
    warn_of_nothing,
)
from ldt_core.cli.outputs import check_file, force_option
from ldt_core.cli.progress import status
from ldt_core.cli.terminal import echo, echo_json

if TYPE_CHECKING:
    from ldt_core.calibration import Calibration
    from ldt_core.diagnosis.fitted_along import Used

#: Characters of a name that leave the usual terminal room for an interval; others take two lines.
LONGEST_NAME = 24
INTERVAL = "95 % interval"  # the column that is folded where the terminal is narrow


def _names(_context: click.Context, option: click.Parameter, text: str | None) -> list[str]:
    names = [name.strip() for name in (text or "").split(",") if name.strip()]
    if text is not None and not names:
        raise OptionError(option.opts[0], "names of parameters, as in J,K_t", repr(text))
    return names


@click.command("calibrate", short_help="Fit a machine file; says what the data cannot determine.")
@click.argument("recordings", nargs=-1, required=True)
@parameters("machine")
@click.option(
    "--free",
    callback=_names,
    metavar="NAME,...",
    help="Parameters to fit; without it, the largest set that the recordings determine.",
)
@click.option(
    "--fixed", callback=_names, metavar="NAME,...", help="Parameters that keep the file's values."
)
@diagnosis_option("The diagnosis.json whose effects are added to the file and fitted too.")
@new_file_option
@force_option
@judged_option
@declared_option("only")
@namespace_option
@click.option(
    "--figure", metavar="FILE", help="Draw measured, before and after (.png, .svg, .pdf)."
)
@json_option
def command(
    settings: dict[str, Any],
    recordings: tuple[str, ...],
    free: list[str],
    fixed: list[str],
    diagnosis: str,
    out: str,
    force: bool,
    holdout: float | None,
    only: str,
    namespace: str,
    figure: str | None,
    as_json: bool,
) -> None:
    """Fit the machine file's parameters to RECORDINGS; each experiment is a separate free run.

    Says which parameters the recordings cannot tell apart, and judges the fit on held-out
    experiments. Intervals are withheld if the physics clearly lacks something. Then `ldt diagnose`
    finds it, and --with adds it to the file; all parameters are then fitted within their
    tolerances. Experiments of several recordings are numbered consecutively.

    Example: ldt calibrate bag --machine dc_motor --free J,K_t,b --out my_motor.yaml
    """
    from ldt_core.calibration import calibrate
    from ldt_core.calibration.calibrate import check_names
    from ldt_core.calibration.held_out import split_evenly
    from ldt_core.calibration.machine_yaml import write_machine_file
    from ldt_core.cli.recordings import naming, read_recordings
    from ldt_core.machine.machine_file import load_machine
    from ldt_core.views.figures.free_run_panels import draw_calibration
    from ldt_core.views.page import style

    machine = load_machine(settings["machine"])
    acting: list[Used] = []
    along: list[Used] = []
    if diagnosis:
        from ldt_core.diagnosis.diagnosis import read_diagnosis
        from ldt_core.diagnosis.fitted_along import acting_and_along

        found_keys = read_diagnosis(diagnosis, machine)
        acting, along = acting_and_along(diagnosis, found_keys, machine)
        warn_of_nothing(diagnosis, acting)
    check_names(machine.with_effects(acting), free, fixed)
    check_file(out, force)
    if figure:
        style.check_picture(figure, "--figure", "--figure")
        check_file(figure, force, "--figure")
    experiments = read_recordings(recordings, namespace, machine, only)
    with naming(recordings), status("{}: {} simulations of the recording") as tick:
        found = calibrate(
            machine,
            experiments,
            free=free,
            fixed=fixed,
            holdout=holdout,
            acting=acting,
            along=along,
            tick=tick,
        ).with_recordings(recordings)
    write_machine_file(found, out, force)
    if figure:
        kept, held_out, _ = split_evenly(experiments, holdout)
        draw_calibration(found, held_out or kept, figure)
    if as_json:
        record = {"machine": machine.name, "out": out, **found.as_dict()}
        echo_json(record)
    else:
        _print(found, out)
        _print_next(found, recordings, only, out)


def _print(found: Calibration, out: str) -> None:
    table = Table(title=f"{found.machine.name} calibrated")
    columns = ("parameter", "in the file", "calibrated", INTERVAL, "unit")
    for column in columns:
        table.add_column(column, justify="left" if column in ("parameter", "unit") else "right")
    for e in found.estimates:
        none = "not determined" if found.lacking == [] else "withheld"
        interval = f"{e.ci95[0]:.5g} to {e.ci95[1]:.5g}" if e.ci95 else none
        table.add_row(_in_lines(e.name), f"{e.nominal:.5g}", f"{e.value:.5g}", interval, e.unit)
    units = {p.name: p.unit for p in found.machine.model.parameters}
    for name, reason in found.fixed.items():
        value = f"{found.nominal.parameters[name]:.5g}"
        table.add_row(_in_lines(name), value, "kept", reason, units[name])
    console = Console()
    console.print_folded(table, *(c for c in columns if c != INTERVAL))
    for part, (before, after) in found.errors.items():
        where = {"fit": "fitted", "held_out": "held out"}[part]
        many = counted(len(found.experiments[part]), "experiment")
        console.print(
            f"free-run error on {many} {where}: {before.rmse:.4g} rad/s before, "
            f"{after.rmse:.4g} after (mean maximum {before.mean_max_error:.4g} and "
            f"{after.mean_max_error:.4g})",
        )
    for note in found.notes:
        console.print(one_line(f"- {note}"))
    console.print(f"machine file: {out}")


def _in_lines(name: str) -> str:
    return name.replace(".", ".\n") if len(name) > LONGEST_NAME else name


def _print_next(found: Calibration, recordings: Sequence[str], only: str, out: str) -> None:
    """What to do with the file, and the command."""
    from ldt_core.cli.recordings import as_arguments

    played, file = as_argument(recordings[0]), as_argument(out)
    words, command = "let the twin watch", f"ldt run --play {played} --machine {file} --out played"
    if found.lacking != []:
        given = as_arguments(recordings, only)
        words, command = "what it lacks", f"ldt diagnose {given} --machine {file} --out why"
    echo(one_line(f"Next, {words}: {command}"))
