"""`ldt doctor`: what is wrong with this machine or with a recording, and how to mend it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from ldt_core.base.errors import OptionError
from ldt_core.base.printable import one_line
from ldt_core.cli.options import json_option, namespace_option
from ldt_core.cli.terminal import echo_json

if TYPE_CHECKING:
    from ldt_core.doctor.check import Finding

COLOURS = {"ok": "green", "warning": "yellow", "problem": "red"}


@click.command("doctor", short_help="Find problems of this computer or of a recording.")
@click.argument("recording", required=False)
@click.option(
    "--bag", default="", help="Folder that a run would record to, if not under ldt_recordings."
)
@click.option(
    "--machine", metavar="FILE", help="Machine file whose physics and effects of your own to check."
)
@click.option(
    "--repair",
    "mend",
    is_flag=True,
    help="Write the damaged files of RECORDING again, with every readable message; the damaged "
    "files are kept next to them.",
)
@namespace_option
@json_option
def command(
    recording: str | None,
    bag: str,
    machine: str | None,
    mend: bool,
    namespace: str,
    as_json: bool,
) -> int:
    """Find what prevents `ldt up` from running well here, damage in RECORDING, or faults in what
    you wrote for a machine file.

    Each check prints one line: ok, warning or problem, and after -> what to do about it. The exit
    code is 0 if there is no problem, else 1. Nothing is changed without --repair.

    Example: ldt doctor
    """
    from ldt_core.doctor import check, computer_checks

    if machine is not None:
        if recording is not None or mend:
            raise OptionError("--machine", "no RECORDING beside it", recording or "--repair")
        from ldt_core.doctor.machine_checks import findings as machine_findings

        found = machine_findings(machine)
    elif recording is None:
        if mend:
            raise OptionError("--repair", "a RECORDING to repair", "none")
        found = check.run_probes([*computer_checks.probes(bag), *check.found_probes()])
    elif mend:
        from ldt_core.doctor.recording_checks import mended

        found = mended(recording, namespace)
    else:
        from ldt_core.doctor.recording_checks import findings, model_findings
        from ldt_core.recording.bag import read_bag
        from ldt_core.recording.health import inspect

        found = findings(inspect(read_bag(recording, namespace)))
        found += model_findings(recording, namespace)
    passed = check.passed(found)
    if as_json:
        echo_json({"ok": passed, "checks": [f.as_dict() for f in found]})
    else:
        _print(found)
    return 0 if passed else 1


def _print(found: Sequence[Finding]) -> None:
    width = max(len(f.name) for f in found)
    for finding in found:
        grade = click.style(f"{finding.grade:8}", fg=COLOURS[finding.grade])
        remedy = f" -> {finding.remedy}" if finding.remedy else ""
        sentence = one_line(f"{finding.message}{remedy}")
        click.echo(f"{grade} {finding.name:{width}}  {sentence}")
