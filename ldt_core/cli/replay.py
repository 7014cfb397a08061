"""`ldt replay`: a recording through twin, detector and adaptor again."""

from __future__ import annotations

from functools import partial
from typing import Any

import click

from ldt_core.cli.options import (
    Command,
    declared_option,
    json_option,
    namespace_option,
    out_option,
    parameters,
    preset_option,
)
from ldt_core.cli.outputs import force_option, replacing
from ldt_core.cli.progress import RunProgress, interrupted_run, print_summaries


@click.command(
    "replay", cls=Command, short_help="Run a recording again, with the same or other settings."
)
@click.argument("recording")
@out_option
@force_option
@declared_option("only")
@namespace_option
@preset_option
@json_option
@parameters("machine", "model", "detector", "adaptor", "diagnosis", "advice", "pace")
def command(
    settings: dict[str, Any],
    recording: str,
    out: str,
    force: bool,
    only: str,
    namespace: str,
    as_json: bool,
) -> None:
    """Play RECORDING through twin, detector and adaptor, with the same or other settings.

    Ctrl-C stops cleanly after the current experiment, or after 5 s, with exit code 130, and prints
    the command that continues.

    Example: ldt replay my_run --detector lddm --error-threshold 0.5 --out my_run_lddm
    """
    from ldt_core.base.metrics import Summary
    from ldt_core.base.stopping import INTERRUPTED, stop_on_signals
    from ldt_core.machine.machine_file import load_machine
    from ldt_core.recording.bag import read_bag
    from ldt_core.recording.pace import paced, parse_rate
    from ldt_core.runs import offline

    machine = load_machine(settings["machine"])
    rate = 1.0 if settings["real_time"] else parse_rate(settings["rate"])
    played = read_bag(recording, namespace, only=only)
    summary = Summary()
    with stop_on_signals() as stop, replacing(out, force, [recording]):
        with RunProgress({machine.name: None}) as progress:
            offline.run(
                machine,
                {**settings, "play": recording, "play_namespace": namespace, "only": only},
                paced(played.experiments(refused=summary.reject), rate, stop),
                out,
                partial(progress.show_step, machine.name),
                summary=summary,
                in_time=stop.in_time,
            )
        summary.note(*played.notes)
        if stop.is_set():
            summary.note(INTERRUPTED)
        runs = [(machine.name, summary, out)]
        print_summaries(runs, settings, as_json)
        if stop.is_set():
            raise interrupted_run(runs, {**settings, "play": recording})
