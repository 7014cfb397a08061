"""What runs a graph's settings ask for, checked before any of its nodes begins."""

from __future__ import annotations

import re
import time
from typing import Any

from ldt_core.base.errors import BadInput
from ldt_core.base.metrics import Summary
from ldt_core.base.settings import FROM_FILE
from ldt_core.detectors import DETECTORS
from ldt_core.machine.machine_file import load_machine
from ldt_core.models import MODELS
from ldt_core.recording.bag import read_bag
from ldt_core.recording.pace import parse_rate
from ldt_core.recording.run_settings import settings_text
from ldt_core.restart.run_key import begin_of, check_key
from ldt_core.runs.fleet_members import fleet
from ldt_ros.graph.node_graph import Run

NAMESPACE = re.compile(r"/?([A-Za-z_]\w*(/[A-Za-z_]\w*)*)?/?", re.ASCII)


def plan(settings: dict[str, Any]) -> list[Run]:
    """One run a machine.

    Raises:
        LdtError: settings that cannot be used.
    """
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
            check_key(read_bag(member.bag, listed=True), machine)
            member.settings["start_time"] = begin_of(member.bag, member.settings["start_time"])
        if run.source == "plant" and member.settings["start_time"] == FROM_FILE:
            # A plant that is started again must not take another moment for the present.
            member.settings["start_time"] = time.time()
        runs.append(run)
    return runs
