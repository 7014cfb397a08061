"""`ldt rollback`: the models of a run, and going back to one of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

from ldt_core.base.printable import one_line
from ldt_core.cli.options import json_option, namespace_option
from ldt_core.cli.terminal import echo_result

if TYPE_CHECKING:
    from ldt_core.restart.rollback import History


@click.command("rollback", short_help="Go back to an earlier model of a run.")
@click.argument("recording")
@click.option("--to", "version", type=click.INT, help="Version to continue with.")
@click.option("--machine", default="", help="Machine file, if the run was started with one.")
@namespace_option
@json_option
def command(
    recording: str, version: int | None, machine: str, namespace: str, as_json: bool
) -> None:
    """List the models used in RECORDING, which is a run; with --to, go back to one of them.

    Nothing is deleted: the earlier model is recorded again as the next version, and the run
    continues with it when you resume it with --resume. Later models and the experiments kept for
    learning are no longer used. The run must have ended.

    Example: ldt rollback my_run --to 2
    """
    from ldt_core.restart.rollback import history, roll_back

    found = history(recording, namespace, machine)
    if version is None:
        echo_result(as_json, found.as_dict(), *_lines(found))
        return
    done = roll_back(found, version)
    record = {"in_force": done.model_version, "rolled_back_to": version, "reason": done.reason}
    record["experiment"] = done.experiment
    echo_result(as_json, record, f"{done.reason}; go on with --resume {recording}")


def _lines(found: History) -> Iterator[str]:
    yield "version  adopted  predicted  mean max error  held back: before -> after  faulty sensor"
    for r in found.terms:
        error = "-" if r.mean_max_error is None else f"{r.mean_max_error:.4g} rad/s"
        compared = "-"
        if r.before is not None and r.after is not None:
            compared = f"{r.before:.4g} -> {r.after:.4g} rad/s"
        when = f"at {r.adopted}" if r.adopted else "first"
        yield (
            f"{r.version:7}  {when:>7}  {r.experiments:9}  {error:>14}  {compared:>26}  "
            f"{r.faulty or '-':>13}"
        )
        if r.adopted:
            yield f"         {one_line(r.reason)}"
        if why := found.unusable.get(r.version):
            yield f"         cannot be used: {one_line(why)}"
    yield f"version {found.terms[-1].version} is in use"
