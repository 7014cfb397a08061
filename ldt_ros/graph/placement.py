"""Which process hosts which nodes of which machines, and what it is told."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

import msgs_config
from ldt_ros.graph.machine_run import MachineRun
from ldt_ros.graph.process import machine_arguments
from ldt_ros.graph.secure import enclave_arguments

MIN_FLEET_PROCESSES = 8  # that a fleet may have, however few cores there are


@dataclass(frozen=True)
class HostProcess:
    """A process that hosts nodes.

    Args:
        name: for messages and for the file of its output.
        runs: of the machines whose nodes it hosts.
        role: of its only node, "" where it hosts all nodes of its machines.
        arguments: of `ldt_ros.graph.process`.
    """

    name: str
    runs: Sequence[MachineRun]
    role: str
    arguments: Sequence[str]

    @property
    def records(self) -> bool:
        """Whether a recorder is in it."""
        return self.role in ("", "recorder")


def host_processes(runs: Sequence[MachineRun], folder: Path) -> list[HostProcess]:
    """A process a node; of a fleet, all nodes of one machine or of several in a process.

    A process more holds 60 MB, and has to get to know all topics of all others, as they have to get
    to know its own.

    Args:
        runs: one a machine, of the same settings but for names and seeds.
        folder: gets the files of the nodes' parameters.
    """
    first = runs[0]
    roles = first.settings["graph"]
    if len(runs) == 1:
        ros = machine_arguments(first.namespace, write_parameters(first, folder))
        return [
            HostProcess(role, runs, role, ["--node", role, *ros, *_enclave(first, role)])
            for role in roles
        ]
    count = first.settings["processes"] or max(MIN_FLEET_PROCESSES, 2 * (os.cpu_count() or 1))
    # An enclave is one machine's, and a process is in one enclave.
    most = 1 if first.settings["secure"] else -(-len(runs) // count)
    nodes = [word for role in roles for word in ("--node", role)]
    found = []
    for begin in range(0, len(runs), most):
        group = runs[begin : begin + most]
        name = "-".join(dict.fromkeys((group[0].name, group[-1].name)))
        files = ((run.namespace, write_parameters(run, folder)) for run in group)
        machines = [word for one in files for word in ("--machine", *one)]
        ros = ["--ros-args", *_enclave(group[0], roles[0])]
        found.append(HostProcess(name, group, "", [*nodes, *machines, *ros]))
    return found


def write_parameters(run: MachineRun, folder: Path, **others: str) -> str:
    """Write what a machine's nodes are told, those that start from now on; the file's name."""
    defaults = {n: d["default"] for n, d in msgs_config.parameters().items()}
    values = {n: v for n, v in run.settings.items() if v != defaults[n]}
    file = folder / f"{run.name}.yaml"
    file.write_text(yaml.safe_dump({"/**": {"ros__parameters": {**values, **others}}}))
    return str(file)


def _enclave(run: MachineRun, role: str) -> list[str]:
    return enclave_arguments(run.settings, run.namespace, role)
