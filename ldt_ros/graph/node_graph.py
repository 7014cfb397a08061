"""The processes and monitors of a graph: started, watched, ended in order."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from ldt_core.base.errors import BadInput
from ldt_core.base.experiment import Adaptation, Signal
from ldt_core.base.stopping import INTERRUPTED
from ldt_core.recording.node_status import NodeStatus
from ldt_core.runs.fleet_members import SOURCES
from ldt_core.runs.offline import recorded_summary
from ldt_ros.graph.environment import spun_nodes
from ldt_ros.graph.machine_run import MachineRun, host_processes
from ldt_ros.graph.monitor import Monitor
from ldt_ros.graph.process import HALT
from ldt_ros.graph.respawn import Respawner
from ldt_ros.graph.supervisor import Child, NodeFailure, Supervisor
from ldt_ros.nodes.statements import hear
from ldt_ros.nodes.topics import LEASE

if TYPE_CHECKING:
    from rclpy.context import Context

LISTEN = 0.3  # s for rivals in this domain to show themselves; discovery takes at most 0.25 s
SETTLE = 3.0  # s without an answer, after which none is waited for; twice that for one under way
SPIN = 0.05  # s between two looks at the processes
RIVAL_WATCH = 5.0  # s after the first step; a rival that comes later ends no long run
RIVAL_REST = 20.0  # times as long as looking for rivals took, this process does something else
ANOTHER_PLACE = "(use another ROS_DOMAIN_ID or --namespace)"

OnStep = Callable[[str, Signal, Adaptation], None]
OnWarning = Callable[[str, str], None]


class Graph:
    """The processes and monitors of all runs.

    Args:
        on_warning: told the machine, and what a node says that a person should look at.
    """

    def __init__(
        self,
        runs: list[MachineRun],
        supervisor: Supervisor,
        on_step: OnStep,
        on_warning: OnWarning = lambda machine, words: None,
    ) -> None:
        self.runs = runs
        self.supervisor = supervisor
        self.on_step, self.on_warning = on_step, on_warning
        self.monitors: list[Monitor] = []
        self._rivals_due = 0.0

    def run(self, stopped: Callable[[], bool]) -> None:
        """Start everything, wait for the end, and end in order.

        Raises:
            BadInput: a domain that is taken, or in which no node can be created.
            LdtError: a node died, or did not start.
        """
        what = "a domain and namespace that a node can be created in"
        with spun_nodes(self._make_monitors, what) as (self.monitors, self._executor):
            self.supervisor.wait = self._listen
            try:
                self._run(stopped)
            finally:
                self.supervisor.stop_all()
                self.supervisor.wait = time.sleep

    def _make_monitors(self, context: Context) -> list[Monitor]:
        monitors = [
            Monitor(
                r.namespace,
                self._recipient(r),
                r.settings["adaptation_timeout"],
                self._warned(r),
                context=context,
            )
            for r in self.runs
        ]
        # One ear for all machines: each hears all.
        hear(monitors[0], {m.get_namespace(): m.hear for m in monitors})
        return monitors

    def _recipient(self, run: MachineRun) -> Callable[[Signal, Adaptation], None]:
        return lambda signal, adaptation: self.on_step(run.name, signal, adaptation)

    def _warned(self, run: MachineRun) -> Callable[[str, str], None]:
        return lambda role, words: self.on_warning(run.name, f"{role}: {words}")

    def _run(self, stopped: Callable[[], bool]) -> None:
        self._listen(LISTEN)
        expected = f"no publisher before the graph starts {ANOTHER_PLACE}"
        self._refuse_publishers(0, expected, "publisher(s) in this domain")
        names = (run.name for run in self.runs)
        respawner = Respawner(self.supervisor, dict(zip(names, self.monitors, strict=True)))
        hosts = host_processes(self.runs, self.supervisor.folder)
        children = {host.name: respawner.start(host) for host in hosts}
        recorders = [children[host.name] for host in hosts if host.records]
        began = time.monotonic()
        patience = respawner.patience
        while not (stopped() or self._finished()):
            self._listen(SPIN)
            respawner.look()
            self._notice_rivals(respawner.restarted_at)
            if time.monotonic() - began > patience and not all(m.health for m in self.monitors):
                reason = f"the nodes did not start within {patience:g} s"
                raise NodeFailure(reason, self.supervisor.folder)
        if stopped():
            for child in self.supervisor.children:
                if child.running:  # a stopped one goes on, and answers what it has missed
                    child.send(HALT if child.name in SOURCES else signal.SIGCONT)
            if not self._sources():
                # A fleet's process has all the nodes of its machines, and ends as a whole.
                self.supervisor.stop(*recorders)
                recorders = []
        while True:
            self._settle(respawner, recorders, stopped)
            interrupted = stopped()
            # The recorder drains while those who could send something again are still there.
            self.supervisor.stop(*recorders)
            if not (killed := [c for c in recorders if _killed_by_others(c)]):
                break
            respawner.revive(killed)  # for what it lacks
        self._sum_up(respawner, interrupted)

    def _settle(
        self, respawner: Respawner, recorders: list[Child], stopped: Callable[[], bool]
    ) -> None:
        """Wait until all that was sent has gone all the way, and is heard by all who record."""
        deadline = time.monotonic() + (2 * SETTLE if stopped() else SETTLE)
        while time.monotonic() < deadline:
            recording = all(map(respawner.is_up, recorders))
            if recording and all(m.idle for m in self.monitors):
                return
            self._listen(SPIN)
            if stopped():
                respawner.revive(c for c in recorders if _killed_by_others(c))
            else:
                respawner.look()
            if not recording or (not stopped() and any(m.busy for m in self.monitors)):
                deadline = time.monotonic() + SETTLE

    def _sum_up(self, respawner: Respawner, interrupted: bool) -> None:
        """Fill the summaries from the recordings, with what a person should know beside it."""
        for run in self.runs:
            if interrupted:
                run.summary.note(INTERRUPTED)
            recorded_summary(run.bag, run.namespace, run.machine, run.summary)
        respawner.note()
        for run, monitor in zip(self.runs, self.monitors, strict=True):
            run.note_health(monitor.health, monitor.answered)
            if not (interrupted or monitor.source_finished):
                run.summary.fail(f"the {run.source} was ended before its last experiment")

    def _sources(self) -> list[Child]:
        """Processes of their own that send the experiments."""
        return [c for c in self.supervisor.children if c.name in SOURCES]

    def _finished(self) -> bool:
        """Whether every source has nothing more to send.

        Of a process of its own that one's word counts: another graph that is just being refused
        says the same under the same name.
        """
        if sources := self._sources():
            told = self.monitors[0].health
            return all(c.ended_well or _has_finished(c, told.get(c.name)) for c in sources)
        return all(m.source_finished for m in self.monitors)

    def _listen(self, seconds: float) -> None:
        """Deal with all that comes meanwhile; what is done in between costs more than a message."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left)

    def _notice_rivals(self, restarted_at: float) -> None:
        """Two graphs that start at the same moment see each other only after they have begun."""
        first = [m.first_step_at for m in self.monitors if m.first_step_at is not None]
        now = time.monotonic()
        if (first and now - min(first) > RIVAL_WATCH) or now - restarted_at < LEASE:
            return
        if now < self._rivals_due:
            return
        self._refuse_publishers(1, f"one publisher {ANOTHER_PLACE}", "in this domain")
        # Every count goes through all that there is: of many machines, it would take all the time.
        end = time.monotonic()
        self._rivals_due = end + RIVAL_REST * (end - now)

    def _refuse_publishers(self, most: int, expected: str, counted: str) -> None:
        """Refuse more publishers of a topic of a machine's own than there may be."""
        for run, monitor in zip(self.runs, self.monitors, strict=True):
            for topic in run.own_topics:
                if (count := monitor.count_publishers(topic)) > most:
                    raise BadInput(
                        monitor.resolve_topic_name(topic), expected, f"{count} {counted}"
                    )


def _has_finished(source: Child, told: NodeStatus | None) -> bool:
    """Whether it is this process that said so."""
    return told is not None and told.finished and told.process == source.pid


def _killed_by_others(child: Child) -> bool:
    """Whether it was killed, and not by this process, which has waited long enough."""
    return child.crashed and child.told != signal.SIGKILL
