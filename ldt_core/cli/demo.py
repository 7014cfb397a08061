"""`ldt demo`: a first run, and its page."""

from __future__ import annotations

import click

from ldt_core.base.printable import one_line
from ldt_core.cli.options import json_option
from ldt_core.cli.outputs import force_option, replacing
from ldt_core.cli.progress import RunProgress
from ldt_core.cli.terminal import echo_result

RUN = {"experiments": 40, "seed": 3}  # those of the README's first command; 20 s of a processor


@click.command("demo", short_help="A first run with a simulated machine, and its page.")
@click.option(
    "-o",
    "--out",
    default="ldt_demo",
    show_default=True,
    help="Folder of the recording and the page.",
)
@force_option
@json_option
def command(out: str, force: bool, as_json: bool) -> None:
    """Run a twin of a simulated rotor that wears, with all defaults, and write its page.

    This takes half a minute. The output says what happened, where the page is, and what to do next.

    Example: ldt demo -o first
    """
    from pathlib import Path

    from ldt_core.base.errors import OptionError
    from ldt_core.base.sentences import counted
    from ldt_core.base.settings import resolve
    from ldt_core.machine import Plant
    from ldt_core.machine.machine_file import load_machine
    from ldt_core.runs import offline
    from ldt_core.views.report.report_page import write_run_page

    if Path(out).exists() and not force:
        raise OptionError("--out", "a folder that does not exist yet (or --force)", out)
    settings = resolve(RUN)
    machine = load_machine(settings["machine"])
    plant = Plant.from_settings(machine, settings)
    experiments = map(plant.experiment, range(1, settings["experiments"] + 1))
    bag, page = str(Path(out) / "run"), str(Path(out) / "run.html")
    with (
        replacing(out, force, marks=("run/metadata.yaml",)),
        RunProgress({machine.name: settings["experiments"]}) as progress,
    ):
        summary = offline.run(
            machine, settings, experiments, bag, lambda step: progress.show_step(machine.name, step)
        )
        write_run_page(bag, page)
    record = {"page": page, "recording": bag, **summary.as_dict()}
    echo_result(
        as_json,
        record,
        *map(one_line, summary.notes),
        f"A simulated rotor lost its balance over {counted(summary.experiments, 'experiment')}. "
        f"The twin learned {counted(summary.adaptations, 'time')}. {summary.outcome}",
        *([one_line(summary.learned)] if summary.learned else []),
        f"Open in a browser: {page}",
        f"See it live:       ldt watch {bag} --rate 100",
        f"What to avoid now: ldt advise {bag}",
        "Your machine:      ldt docs connect",
    )
