"""`ldt report`: a run as a page to look at."""

from __future__ import annotations

import click

from ldt_core.cli.options import json_option, namespace_option
from ldt_core.cli.outputs import check_file, force_option
from ldt_core.cli.terminal import echo, echo_json


@click.command("report", short_help="A run as one page for any browser.")
@click.argument("recording")
@click.option("-o", "--out", required=True, help="File of the page: .html.")
@force_option
@namespace_option
@json_option
def command(recording: str, out: str, force: bool, namespace: str, as_json: bool) -> None:
    """Turn RECORDING, a run of `ldt up`, `run` or `replay`, into one page for any browser.

    It shows every experiment measured and predicted (worst first), the error and the detector's
    statistic over the run, what was learned from which experiments, the diagnoses, and the
    recording's health. The plots can be zoomed; nothing is loaded from a network.

    Example: ldt report my_run -o my_run.html
    """
    from pathlib import Path

    from ldt_core.views.report.report_page import write_run_page

    check_file(out, force, endings=(".html", ".htm"))
    run = write_run_page(recording, out, namespace)
    if as_json:
        facts = {"page": out, "bytes": Path(out).stat().st_size, **run.summary.as_dict()}
        echo_json(facts, indent=2)
    else:
        echo(out)
