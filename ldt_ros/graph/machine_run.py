"""The machines that a graph's settings ask for, and the processes that host their nodes."""

from __future__ import annotations

import math
import os
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

import msgs_config
from ldt_core.base import result_files
from ldt_core.base.errors import BadInput, UnansweredExperiment
from ldt_core.base.metrics import Summary
from ldt_core.base.printable import file_name
from ldt_core.base.sentences import counted, numbered
from ldt_core.base.settings import FROM_FILE
from ldt_core.detectors import DETECTORS
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.models import MODELS
from ldt_core.recording.bag import read_bag
from ldt_core.recording.experiment_numbers import ExperimentNumbers
from ldt_core.recording.message_subject import Subject, agree
from ldt_core.recording.node_status import (
    INTERRUPTIONS,
    LEFT_OUT,
    RESUMED_AT,
    SECOND_PUBLISHER,
    NodeStatus,
)
from ldt_core.recording.pace import parse_rate
from ldt_core.recording.run_settings import settings_text
from ldt_core.restart.recorded_run import RecordedRun
from ldt_core.restart.rollback import withdraw
from ldt_core.restart.run_key import begin_of, check_key
from ldt_core.runs.fleet_members import Member, fleet, roles, source_of
from ldt_ros.graph.process import machine_arguments
from ldt_ros.graph.secure import enclave_arguments

#: Counts in a node's health that are worth a note unless they are 0.
MOST_LISTED = 5  # stretches of missing experiments that a sentence lists
NOTED_COUNTS = ("dropped", "adaptation time-outs", "unpaired", "missing", "overdue")


MIN_FLEET_PROCESSES = 8  # that a fleet may have, however few cores there are


@dataclass(frozen=True)
class MachineRun(Member):
    """One machine of a graph, and what happened with it."""

    machine: Machine
    summary: Summary = field(default_factory=Summary)

    @property
    def source(self) -> str:
        """The role that sends the experiments."""
        return source_of(self.settings)

    @property
    def own_topics(self) -> list[str]:
        """That nobody else may publish: all, but samples only where the graph has them."""
        declared = msgs_config.topics().items()
        wanted = (t for t, d in declared if d["recorded"] or self.settings["stream"])
        return [topic for topic in wanted if not topic.startswith("/")]

    def note_health(self, health: Mapping[str, NodeStatus], answered: ExperimentNumbers) -> None:
        """Note in the summary what the nodes counted, and which experiments are missing.

        Args:
            health: what each node told of itself last, by role.
            answered: experiments of which an adaptation was heard.
        """
        summary = self.summary
        alarms: dict[str, str] = {}
        for role, told in health.items():
            for key, count in told.values.items():
                if key in ("no signal", "no diagnosis", "no advice"):
                    summary.note(f"{key}: {count}")
                elif key.startswith(SECOND_PUBLISHER):
                    alarms.setdefault(key, role)
                elif (key in NOTED_COUNTS or key.startswith(LEFT_OUT)) and count != "0":
                    summary.note(f"{role}, {key}: {count}")
            if told.rejected:
                kinds = ", ".join(f"{kind}: {times}" for kind, times in told.rejected.items())
                summary.note(f"{role} rejected {kinds} ({told.last_rejection})")
            if told.interruption:
                times = counted(told.number(INTERRUPTIONS) or 1, "interruption")
                summary.note(f"{times} of the recording, the last: {told.interruption}")
        if twin := health.get("twin"):
            refused = _experiments_of(twin.rejected)
            failed = f"experiment: {UnansweredExperiment.__name__}"
            summary.rejected += sum(n for kind, n in refused.items() if kind != failed)
            summary.repeated += twin.number("repeated") or 0
        source = health.get(self.source)
        sent = (source.number("sent") if source else 0) or 0
        resumed = (source.number("resumed") if source else 0) or 0
        done = summary.experiments
        if resumed:  # what became of those before, the nodes of this run cannot tell
            about = resumed, float(source.values.get(RESUMED_AT, "nan")) if source else math.nan
            sent, done = sent - resumed, len(since(summary.answered, about))
            summary.recorded = since(summary.recorded, about)
        for key, role in alarms.items():
            of = f"in the domain (as the {role} saw it)"
            summary.fail(f"a {key} {of}: what it sent cannot be told from what this run sent")
        # A segmenter that is started again counts anew.
        strange = len(summary.recorded) - sent if self.source != "segmenter" else 0
        if source and strange > 0:
            which = f"{strange} of {counted(len(summary.recorded), 'experiment')} in the recording"
            summary.fail(f"a stranger's, not sent by the {self.source}: {which}")
        left = sent - summary.repeated - done
        by_twin = min(summary.rejected, left)  # a stranger's may have been refused as well
        if left > by_twin:
            recorder = health.get("recorder")
            why = recorder.interruption if recorder else ""
            summary.fail(self._missing(left - by_twin, sent, answered, why))
        if by_twin > 0:
            why = twin.last_rejection if twin else ""
            summary.fail(self._refused(by_twin, sent, why))
        unusable = sum(_experiments_of(source.rejected).values()) if source else 0
        if source and unusable:  # of the recording that is played
            summary.rejected += unusable
            which = f"{counted(unusable, 'experiment')} of the recording"
            summary.fail(f"{which} cannot be sent, not answered ({source.last_rejection})")

    def _refused(self, refused: int, sent: int, why: str) -> str:
        """Which of those sent the twin refused, and why the last."""
        open_ = self._open()
        which = f": {numbered('experiment', open_.spans, MOST_LISTED)}" if open_ else ""
        return f"{refused} of {sent} experiments sent are refused, not answered{which} ({why})"

    def _missing(self, missing: int, sent: int, answered: ExperimentNumbers, why: str) -> str:
        """Which of those sent are not answered, or not in the recording, and why the latter."""
        summary = self.summary
        lost, open_ = ExperimentNumbers(), self._open()
        known = {number for number, _ in summary.answered}
        for number in answered:
            if number not in known:
                lost.add(number)
        told = []
        reason = f" ({why})" if why else ""
        if lost:
            which = numbered("experiment", lost.spans, MOST_LISTED)
            told.append(f"answered and not in the recording: {which}{reason}")
        if missing > len(lost) and why and not (lost or open_):
            told.append(f"no longer in the recording{reason}")
        elif missing > len(lost):
            # One that the twin refused is recorded too: it is answered so.
            among = "among " if summary.rejected else ""
            which = numbered("experiment", open_.spans, MOST_LISTED)
            told.append(f"not answered: {among}{which}" if open_ else "not answered")
        return f"{missing} of {sent} experiments sent are missing, {'; '.join(told)}"

    def _open(self) -> ExperimentNumbers:
        """Experiments that are recorded, and of which no answer is."""
        known = Counter(number for number, _ in self.summary.answered)
        found = ExperimentNumbers()
        for number in Counter(number for number, _ in self.summary.recorded) - known:
            found.add(number)
        return found


def _experiments_of(rejected: Mapping[str, int]) -> dict[str, int]:
    """How many experiments a node rejected, by kind of error."""
    return {kind: n for kind, n in rejected.items() if kind.startswith("experiment:")}


def since(experiments: list[Subject], last: Subject) -> list[Subject]:
    """Those behind this one, by numbers and ends; where it is not there, those of higher number."""
    for place, (number, end) in enumerate(experiments):
        if number == last[0] and agree(end, last[1]):
            return experiments[place + 1 :]
    return [e for e in experiments if e[0] > last[0]]


def machine_runs(settings: Mapping[str, Any]) -> list[MachineRun]:
    """One run a machine, checked before any node begins.

    Raises:
        LdtError: settings that cannot be used.
    """
    machine = load_machine(settings["machine"])
    # What a node would refuse as well, but a second later and in a process of its own.
    parse_rate(settings["rate"])
    MODELS.require(settings["model"])
    DETECTORS.require(settings["detector"])
    if settings["play"]:
        read_bag(settings["play"], settings["play_namespace"], only=settings["only"])
    if settings["source"] and (settings["play"] or settings["stream"]):
        raise BadInput("source", "no play and no stream beside it", settings["source"])
    if settings["stream"] == "only":
        alone = "'beside' in a graph; `ldt_plant --ros-args -p stream:=only` is a machine alone"
        raise BadInput("stream", alone, "only")
    runs = [MachineRun(**vars(member), machine=machine) for member in fleet(machine, settings)]
    for run in runs:
        own = run.settings
        own["graph"] = roles(own)
        own["run_settings"] = settings_text(own)
        if own["resume"]:
            versions = check_key(read_bag(run.bag, listed=True), machine, own)
            run.summary.note(
                *versions, *withdraw(RecordedRun(run.bag, run.namespace, machine), own)
            )
            own["start_time"] = begin_of(run.bag, own["start_time"])
        if run.source == "plant" and own["start_time"] == FROM_FILE:
            # A plant that is started again must not take another moment for the present.
            own["start_time"] = time.time()
    return runs


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
    """
    first = runs[0]
    roles = first.settings["graph"]
    if len(runs) == 1:
        ros = machine_arguments(first.namespace, write_parameters(first, folder))
        enclaves = {r: enclave_arguments(first.settings, first.namespace, r) for r in roles}
        return [
            HostProcess(role, runs, role, ["--node", role, *ros, *enclaves[role]]) for role in roles
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
        ros = ["--ros-args", *enclave_arguments(first.settings, group[0].namespace, roles[0])]
        found.append(HostProcess(name, group, "", [*nodes, *machines, *ros]))
    return found


def write_parameters(run: MachineRun, folder: Path, **others: str) -> str:
    """Write what a machine's nodes are told, those that start from now on; the file's name.

    The machine is what its file said at first: it may be edited while a run goes on, and a node
    that is started again would go on with another machine.
    """
    folder.mkdir(mode=0o700, exist_ok=True)  # a cleaner of /tmp takes what is old
    defaults = {n: d["default"] for n, d in msgs_config.parameters().items()}
    values = {n: v for n, v in run.settings.items() if v != defaults[n]}
    values["experiments"] = run.settings["experiments"]  # a segmenter that is told none has no end
    if run.settings["machine"] not in msgs_config.machine_names():
        machine = folder / f"{file_name(run.name)}.machine.yaml"
        result_files.write(machine, yaml.safe_dump(run.machine.as_dict(), allow_unicode=True))
        values["machine"] = str(machine)
    file = folder / f"{file_name(run.name)}.yaml"
    result_files.write(file, yaml.safe_dump({"/**": {"ros__parameters": {**values, **others}}}))
    return str(file)
