"""`ldt up`: the whole node graph, headless; also a plain Python script and a function.

python -m ldt_ros.up --experiments 40 --seed 3
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click

from ldt_core.cli import invoke
from ldt_core.cli.display import RunProgress, print_summaries
from ldt_core.cli.options import json_option, parameters
from ldt_core.detectors import DETECTORS
from ldt_core.errors import BadInput, LdtError
from ldt_core.machine import load_machine
from ldt_core.metrics import Summary
from ldt_core.models import MODELS
from ldt_core.pace import parse_rate
from ldt_core.recording.bag import read_bag
from ldt_core.recording.run_settings import settings_text
from ldt_core.resume import begin_of, check_key, resumed
from ldt_core.session import fleet
from ldt_core.settings import FROM_FILE, resolve
from ldt_core.stopping import stop_on_signals
from ldt_ros.environment import prepare, require_ros
from ldt_ros.graph import Graph, OnStep, Run
from ldt_ros.leftovers import SharedMemory
from ldt_ros.secure import secured
from ldt_ros.supervisor import Supervisor

NAMESPACE = re.compile(r"/?([A-Za-z_]\w*(/[A-Za-z_]\w*)*)?/?", re.ASCII)
#: Groups of parameters that `ldt up` offers and hands on to the nodes.
GROUPS = (
    *("machine", "plant", "run", "model", "detector", "adaptor", "diagnosis", "advice"),
    *("player", "pace", "twin", "stream", "segmenter", "cut", "resume"),
)


def launch(
    settings: Mapping[str, Any] | None = None,
    on_step: OnStep = lambda machine, signal, adaptation: None,
    stopped: Callable[[], bool] = lambda: False,
) -> list[Run]:
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
    given = resolve(settings or {})
    if given["resume"]:
        given = resumed(given)
    require_ros()
    runs = _plan(given)
    folder = Path(tempfile.mkdtemp(prefix="ldt-"))
    before = dict(os.environ)
    keep_output = False
    try:
        environment = secured(given, runs[0].roles, prepare(folder))
        with SharedMemory(), ExitStack() as stack:
            supervisor = stack.enter_context(Supervisor(folder, environment, given))
            graph = Graph(runs, supervisor, on_step)
            stack.callback(graph.close)
            graph.run(stopped)
    except LdtError as error:
        keep_output = error.exit_code == LdtError.exit_code
        raise
    finally:
        os.environ.clear()
        os.environ.update(before)
        if not keep_output:
            shutil.rmtree(folder, ignore_errors=True)
    return runs


def _plan(settings: dict[str, Any]) -> list[Run]:
    machine = load_machine(settings["machine"])
    # What a node would refuse as well, but a second later and in a process of its own.
    parse_rate(settings["rate"])
    MODELS.require(settings["model"])
    DETECTORS.require(settings["detector"])
    if settings["play"]:
        read_bag(settings["play"], settings["play_namespace"])
    if settings["source"] and (settings["play"] or settings["stream"]):
        raise BadInput("source", "no play and no stream beside it", settings["source"])
    if settings["stream"] == "only":
        alone = "'beside' in a graph; `ldt_plant --ros-args -p stream:=only` is a machine alone"
        raise BadInput("stream", alone, "only")
    if not NAMESPACE.fullmatch(settings["namespace"]):
        words = "words of letters, digits and underscores, joined by slashes"
        raise BadInput("namespace", words, repr(settings["namespace"]))
    runs = []
    for member in fleet(machine, settings):
        run = Run(machine, member, Summary())
        member.settings["graph"] = run.roles
        member.settings["run_settings"] = settings_text(member.settings)
        if settings["resume"]:
            check_key(read_bag(member.bag), machine)
            member.settings["start_time"] = begin_of(member.bag, member.settings["start_time"])
        if run.source == "plant" and member.settings["start_time"] == FROM_FILE:
            # A plant that is started again must not take another moment for the present.
            member.settings["start_time"] = time.time()
        runs.append(run)
    return runs


@click.command("up")
@parameters(*GROUPS, "recorder", "graph", "security")
@json_option
def command(settings: dict[str, Any], as_json: bool) -> None:
    """Run the whole node graph: machine, twin, detector, adaptor, recorder, and more if asked for.

    It simulates the machine as it degrades (or plays a recording, or listens to a machine's samples
    with --source stream), learns, records, ends by itself after the last experiment or on Ctrl-C,
    and prints what happened.

    Example: ldt up --experiments 40 --seed 3 --bag my_run
    """
    if settings["resume"]:
        settings = resumed(settings)
    machine = load_machine(settings["machine"]).name
    count = settings["machines"]
    names = [f"machine_{i + 1}" for i in range(count)] if count > 1 else [machine]
    total = None if settings["play"] else settings["experiments"]
    shown = RunProgress(dict.fromkeys(names, total))
    with stop_on_signals(insist=False) as stop, shown as progress:
        runs = launch(settings, progress.show, stop.is_set)
    print_summaries([(r.name, r.summary, str(r.bag)) for r in runs], settings, as_json)


if __name__ == "__main__":
    import sys

    sys.exit(invoke(command))
