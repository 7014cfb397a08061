"""`ldt up`: the whole node graph, headless; also a plain Python script and a function.

python -m ldt_ros.up --experiments 40 --seed 3
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from ldt_core.base.settings import ENDLESS, resolve
from ldt_core.base.stopping import stop_on_signals
from ldt_core.cli import invoke
from ldt_core.cli.options import Command, json_option, parameters, preset_option
from ldt_core.cli.outputs import force_option, refuse_force, replacing
from ldt_ros.graph.environment import prepare, require_ros
from ldt_ros.graph.secure import secured
from ldt_ros.graph.shared_memory import shared_memory_cleared
from ldt_ros.graph.supervisor import NodeFailure, Supervisor

if TYPE_CHECKING:
    from ldt_ros.graph.machine_run import MachineRun
    from ldt_ros.graph.node_graph import OnStep, OnWarning

#: Groups of parameters that `ldt up` offers and hands on to the nodes.
GROUPS = (
    *("machine", "plant", "run", "model", "detector", "adaptor", "diagnosis", "advice"),
    *("player", "pace", "twin", "stream", "segmenter", "cut", "resume"),
)


def launch(
    settings: Mapping[str, Any] | None = None,
    on_step: OnStep = lambda machine, signal, adaptation: None,
    stopped: Callable[[], bool] = lambda: False,
) -> list[MachineRun]:
    """Run the node graph to its end.

    Args:
        settings: any of the declared parameters; the rest have their defaults.
        on_step: told the machine, signal and adaptation of each experiment.
        stopped: asked often; the graph ends in order once it says True.

    Returns:
        One run a machine.

    Raises:
        BadInput: settings that cannot be used, no ROS 2, or a domain that is taken.
        LdtError: a node died.
    """
    given = _resumed(resolve(settings or {}))
    with _supervised(given) as supervisor:
        return _run(given, supervisor, on_step, stopped)


@contextmanager
def _supervised(given: Mapping[str, Any]) -> Iterator[Supervisor]:
    """Processes for a graph; from the beginning one of them loads what the nodes need.

    That takes a second. This process imports what it needs itself on another core meanwhile;
    therefore little of it is imported at the top of this file.
    """
    require_ros()
    folder = Path(tempfile.mkdtemp(prefix="ldt-"))
    before = dict(os.environ)
    told = False
    try:
        environment = secured(given, _roles(given), prepare(folder))
        with shared_memory_cleared(), Supervisor(folder, environment, given) as supervisor:
            yield supervisor
    except NodeFailure:
        told = True
        raise
    finally:
        os.environ.clear()
        os.environ.update(before)
        if not told:  # nobody would look into it, and /tmp would fill up
            shutil.rmtree(folder, ignore_errors=True)


def _run(
    given: Mapping[str, Any],
    supervisor: Supervisor,
    on_step: OnStep,
    stopped: Callable[[], bool],
    on_warning: OnWarning = lambda machine, words: None,
) -> list[MachineRun]:
    from ldt_ros.graph.machine_run import machine_runs
    from ldt_ros.graph.node_graph import Graph

    runs = machine_runs(given)
    for run in runs:  # what is known of a run that goes on: its end may be far
        for words in run.summary.notes:
            on_warning(run.name, words)
    Graph(runs, supervisor, on_step, on_warning).run(stopped)
    return runs


def _resumed(settings: dict[str, Any]) -> dict[str, Any]:
    if not settings["resume"]:
        return settings
    from ldt_core.restart.run_key import resumed

    return resumed(settings)


def _is_given(option: str) -> bool:
    """Whether it was typed, or stands in a file of settings."""
    source = click.get_current_context().get_parameter_source(option)
    return source is not ParameterSource.DEFAULT


def _roles(settings: Mapping[str, Any]) -> Iterator[str]:
    """Of the graph; what tells them is imported when somebody asks."""
    from ldt_core.runs.fleet_members import roles

    yield from roles(settings)


@click.command("up", cls=Command, short_help="Run the whole node graph: machine, twin, recording.")
@parameters(*GROUPS, "place", "recorder", "graph", "security")
@force_option
@preset_option
@json_option
def command(settings: dict[str, Any], force: bool, as_json: bool) -> None:
    """Run the whole node graph: machine, twin, detector, adaptor, recorder, and optional nodes.

    It simulates a machine that wears (or plays a recording, or listens to a machine's samples with
    --source stream), learns and records. It ends after the last experiment or on Ctrl-C, and prints
    a summary. A machine that streams has no last one unless you give --experiments.

    Example: ldt up --experiments 40 --seed 3 --out my_run
    """
    if settings["resume"]:
        refuse_force(force)
    elif settings["source"] and not _is_given("experiments"):
        settings["experiments"] = ENDLESS
    settings = _resumed(settings)
    given = resolve(settings)
    out = "" if settings["resume"] else settings["bag"]
    with stop_on_signals(insist=False) as stop, replacing(out, force, [settings["play"]]):
        with _supervised(given) as supervisor:
            from ldt_core.cli.progress import RunProgress, print_summaries
            from ldt_core.machine.machine_file import load_machine

            machine = load_machine(settings["machine"]).name
            count = settings["machines"]
            names = [f"machine_{i + 1}" for i in range(count)] if count > 1 else [machine]
            live = bool(settings["source"]) and settings["experiments"] == ENDLESS
            total = None if settings["play"] or live else settings["experiments"]
            resumed = bool(settings["resume"]) and not settings["play"]
            with RunProgress(dict.fromkeys(names, total), live, resumed) as progress:
                runs = _run(given, supervisor, progress.show, stop.is_set, progress.warn)
        print_summaries([(r.name, r.summary, str(r.bag)) for r in runs], settings, as_json)
    if stop.is_set() and not as_json and runs[0].bag.exists():
        from ldt_core.cli.terminal import echo
        from ldt_core.restart.run_key import command_to_resume

        place = runs[0].bag.parent if count > 1 else runs[0].bag
        echo(f"to go on:  {command_to_resume(settings, place, 'up')}")


if __name__ == "__main__":
    import sys

    sys.exit(invoke(command))
