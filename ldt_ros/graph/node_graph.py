"""The processes and monitors of a graph: started, watched, started again, ended in order."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgs_config
from ldt_core.base.errors import BadInput, LdtError
from ldt_core.base.experiment import Adaptation, Signal
from ldt_core.base.metrics import Summary
from ldt_core.base.stopping import INTERRUPTED
from ldt_core.machine.machine_file import Machine
from ldt_core.recording.node_status import LEFT_OUT, SECOND_PUBLISHER
from ldt_core.runs.fleet_members import SOURCES, Member, roles, source_of
from ldt_core.runs.offline import recorded_summary
from ldt_ros.graph.environment import LEASE, begin, one_line
from ldt_ros.graph.placing import Place, placed, write_parameters
from ldt_ros.graph.supervisor import Child, Supervisor
from ldt_ros.nodes.silence import Silence

if TYPE_CHECKING:
    from ldt_ros.nodes.monitor import Monitor

LISTEN = 0.3  # s for rivals in this domain to show themselves; discovery takes at most 0.25 s
SETTLE = 3.0  # s that an interrupted run waits for the experiment under way
SPIN = 0.05  # s
#: Of a node's health, worth a note.
COUNTS = ("dropped", "adaptation time-outs", "unpaired", "missing", "overdue")
RIVALS = 5.0  # s after the first step; what comes later is a warning that ends no long run
REST = 20.0  # times as long as looking for rivals took, this process does something else
STARTUP = 60.0  # s until all nodes must have found each other
STARTUP_EACH = 3.0  # s more for each machine; a core needs 1.5 s for one and is not alone

OnStep = Callable[[str, Signal, Adaptation], None]


@dataclass
class Crashes:
    """Of one process.

    Attributes:
        count: of all.
        in_a_row: of those without an experiment dealt with in between.
        hung: of those that were killed since nothing came of them any more.
        told: what it had told of itself before the last one.
    """

    count: int = 0
    in_a_row: int = 0
    hung: int = 0
    told: int = 0
    _step: int = -1

    def add(self, step: int) -> None:
        """One more, after the experiment of this number was dealt with."""
        self.count += 1
        self.in_a_row = self.in_a_row + 1 if step == self._step else 1
        self._step = step


@dataclass
class Run:
    """One machine of the graph, and what happened with it.

    Args:
        machine: as its twin knows it.
        member: its name, namespace, settings and recording.
        summary: of its steps.
    """

    machine: Machine
    member: Member
    summary: Summary

    @property
    def name(self) -> str:
        """For people."""
        return self.member.name

    @property
    def namespace(self) -> str:
        """Of its topics."""
        return self.member.namespace

    @property
    def settings(self) -> dict[str, Any]:
        """Of its nodes."""
        return self.member.settings

    @property
    def bag(self) -> Path:
        """Folder of its recording."""
        return self.member.bag

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

    @property
    def roles(self) -> list[str]:
        """All nodes of this machine, the recorder first: it misses nothing then."""
        return roles(self.settings)


class Graph:
    """The processes and monitors of all runs.

    Args:
        runs: one a machine.
        supervisor: of the processes.
        on_step: told of each machine's steps.
    """

    def __init__(self, runs: list[Run], supervisor: Supervisor, on_step: OnStep) -> None:
        self.runs = runs
        self.supervisor = supervisor
        self.on_step = on_step
        self._recorders: list[Child] = []
        self._places: dict[str, Place] = {}  # by the name of a child
        self._crashes: dict[str, Crashes] = {}
        self._restarted_at = -math.inf
        self._silence = Silence()
        self._rivals_due = 0.0
        import rclpy
        from rclpy.experimental import EventsExecutor

        from ldt_ros.nodes.monitor import Monitor
        from ldt_ros.nodes.statements import hear

        try:
            # A context of its own: the caller may have nodes in the default one.
            self.context = rclpy.Context()
            begin(self.context)
            self.monitors = [
                Monitor(r.namespace, self._recipient(r), context=self.context) for r in runs
            ]
            self._monitor_of = {r.name: m for r, m in zip(runs, self.monitors, strict=True)}
            # One ear for all machines: each hears all.
            hear(self.monitors[0], {m.get_namespace(): m.hear for m in self.monitors})
        except Exception as error:
            rclpy.try_shutdown(context=self.context)
            raise BadInput(
                "ROS 2", "a domain and namespace that a node can be created in", one_line(error)
            ) from error
        self.executor = EventsExecutor(context=self.context)
        for monitor in self.monitors:
            self.executor.add_node(monitor)
        supervisor.wait = self._listen

    def run(self, stopped: Callable[[], bool]) -> None:
        """Start everything, wait for the end, and end in order."""
        self._refuse_rivals()
        self._start()
        began = time.monotonic()
        patience = STARTUP + STARTUP_EACH * len(self.runs)
        while not (stopped() or self._finished()):
            self._spin()
            self._notice_rivals()
            if time.monotonic() - began > patience and not all(m.health for m in self.monitors):
                raise LdtError(f"the nodes did not start within {patience:g} s")
        if stopped():
            sources = [c for c in self.supervisor.children if c.name in SOURCES]
            # A fleet's process has all the nodes of its machines, and ends as a whole.
            self.supervisor.stop(*(sources or self._recorders))
        deadline = time.monotonic() + SETTLE
        while not all(m.idle for m in self.monitors) and time.monotonic() < deadline:
            self._spin(ending=stopped())
            if not stopped() and any(m.busy for m in self.monitors):
                deadline = time.monotonic() + SETTLE
        if stopped():
            for run in self.runs:
                run.summary.note(INTERRUPTED)
        # The recorder drains while those who could send a lost packet again are still there.
        self.supervisor.stop(*self._recorders)
        for run in self.runs:
            recorded_summary(run.bag, run.namespace, run.machine, run.summary)
        self._collect_notes()

    def close(self) -> None:
        """End every process and the monitors."""
        import rclpy

        self.supervisor.stop_all()
        self.supervisor.wait = time.sleep
        for monitor in self.monitors:
            monitor.destroy_node()
        self.executor.shutdown()
        rclpy.try_shutdown(context=self.context)

    def _finished(self) -> bool:
        """Whether every source has nothing more to send.

        A process of its own has ended then. Its word counts where there is none: another graph
        that is just being refused says the same under the same name.
        """
        sources = [c for c in self.supervisor.children if c.name in SOURCES]
        if sources:
            return all(c.ended_well for c in sources)
        return all(m.source_finished for m in self.monitors)

    def _recipient(self, run: Run) -> Callable[[Signal, Adaptation], None]:
        return lambda signal, adaptation: self.on_step(run.name, signal, adaptation)

    def _refuse_rivals(self) -> None:
        self._listen(LISTEN)
        for run, monitor in zip(self.runs, self.monitors, strict=True):
            for topic in run.own_topics:
                if monitor.count_publishers(topic):
                    where = monitor.resolve_topic_name(topic)
                    raise BadInput(
                        where,
                        "no publisher before the graph starts (use another ROS_DOMAIN_ID or "
                        "--namespace)",
                        f"{monitor.count_publishers(topic)} publisher(s) in this domain",
                    )

    def _start(self) -> None:
        for place in placed(self.runs, self.supervisor.folder):
            child = self.supervisor.start(place.name, *place.arguments)
            self._places[place.name] = place
            if place.records:
                self._recorders.append(child)

    def _listen(self, seconds: float) -> None:
        """Deal with all that comes meanwhile; what is done in between costs more than a message."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=left)

    def _spin(self, ending: bool = False) -> None:
        self._listen(SPIN)
        if not ending:
            self._notice_hung()
            self._notice_deaths()

    def _notice_hung(self) -> None:
        """Kill whoever has told nothing of itself for too long, once it had begun to."""
        running = [c for c in self.supervisor.children if c.running]
        self._silence.look({c.name: self._statements(c) for c in running})
        after = self.runs[0].settings["hung_after"]
        for child in running:
            heard = self._silence.told(child.name) > self._crashes.get(child.name, Crashes()).told
            if heard and after and self._silence.hung(child.name, after):
                self._crashes.setdefault(child.name, Crashes()).hung += 1
                self._silence.forgive(child.name)
                self.supervisor.kill(child)

    def _statements(self, child: Child) -> int:
        """How often the nodes of a process have told something of themselves."""
        place = self._places[child.name]
        of = [m.statements for m in self._monitors_of(place)]
        return sum(s[place.role] if place.role else s.total() for s in of)

    def _monitors_of(self, place: Place) -> list[Monitor]:
        """Those of a place's machines."""
        return [self._monitor_of[run.name] for run in place.runs]

    def _notice_deaths(self) -> None:
        for child in self.supervisor.dead():
            if child.ended_well and child.name in SOURCES:
                continue  # a source ends by itself after its last experiment
            code, words = child.process.returncode, child.last_words()
            if code == BadInput.exit_code:
                _, _, sentence = words.partition(": ")
                raise _Refused(sentence or words)
            if not child.crashed or not self._start_again(child):
                raise LdtError(
                    f"{child.name} ended with code {code}: {words} (all output: {child.log.parent})"
                )

    def _start_again(self, child: Child) -> bool:
        """Start a crashed child once more, unless it crashes again and again; whether it was."""
        place = self._places[child.name]
        crashes = self._crashes.setdefault(child.name, Crashes())
        crashes.add(sum(monitor.last_step for monitor in self._monitors_of(place)))
        crashes.told = self._silence.told(child.name)
        if crashes.in_a_row > self.runs[0].settings["restarts"]:
            return False
        self._restarted_at = time.monotonic()
        for run in place.runs:
            write_parameters(run, self.supervisor.folder, resume=str(run.bag))
        self.supervisor.restart(child)
        return True

    def _notice_rivals(self) -> None:
        """Two graphs that start at the same moment see each other only after they have begun."""
        first = [m.first_step_at for m in self.monitors if m.first_step_at is not None]
        now = time.monotonic()
        if (first and now - min(first) > RIVALS) or now - self._restarted_at < LEASE:
            return
        if now < self._rivals_due:
            return
        for run, monitor in zip(self.runs, self.monitors, strict=True):
            for topic in run.own_topics:
                count = monitor.count_publishers(topic)
                if count > 1:
                    raise BadInput(
                        monitor.resolve_topic_name(topic),
                        "one publisher (use another ROS_DOMAIN_ID or --namespace)",
                        f"{count} in this domain",
                    )
        # Every count goes through all that there is: of many machines, it would take all the time.
        end = time.monotonic()
        self._rivals_due = end + REST * (end - now)

    def _collect_notes(self) -> None:
        """What the nodes counted that a person should know, and what is missing."""
        for name, crashes in self._crashes.items():
            crashed, hung = crashes.count - crashes.hung, crashes.hung
            for run in self._places[name].runs:
                if crashed:
                    run.summary.note(f"{name} crashed {_times(crashed)} and was started again")
                if hung:
                    run.summary.note(f"{name} hung {_times(hung)}, was killed and started again")
        for run, monitor in zip(self.runs, self.monitors, strict=True):
            summary, health = run.summary, monitor.health
            for role, told in health.items():
                for key, count in told.values.items():
                    if key in ("no diagnosis", "no advice"):
                        summary.note(f"{key}: {count}")
                    elif key.startswith(SECOND_PUBLISHER):
                        summary.note(f"alarm: a {key}, {count}x as {role} saw it")
                    elif (key in COUNTS or key.startswith(LEFT_OUT)) and count != "0":
                        summary.note(f"{role}, {key}: {count}")
                for kind, times in told.rejected.items():
                    summary.note(f"{role} rejected {kind}: {times} ({told.last_rejection})")
            if twin := health.get("twin"):
                refused = (n for kind, n in twin.rejected.items() if kind.startswith("experiment:"))
                summary.rejected += sum(refused)
                summary.repeated += twin.number("repeated") or 0
            source = health.get(run.source)
            sent = (source.number("sent") if source else 0) or 0
            missing = sent - summary.rejected - summary.repeated - summary.experiments
            if missing > 0:
                summary.note(f"{missing} of {sent} experiments sent did not go all the way")


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


class _Refused(LdtError):
    """A node refused its input; the sentence is the node's own."""

    exit_code = BadInput.exit_code
