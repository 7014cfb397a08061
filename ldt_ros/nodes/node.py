"""What all nodes of the graph share: parameters, topics, health, and an end in order."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.node_status import (
    FINISHED,
    HEALTH_TOPIC,
    LAST_REJECTION,
    PROCESS,
    READY,
    REJECTED,
    STOPPED,
)
from ldt_core.restart.recorded_run import RecordedRun
from ldt_ros.nodes.interfaces import declare, qos
from ldt_ros.nodes.own_recording import OwnRecording
from ldt_ros.nodes.topics import Topics
from ldt_ros.nodes.watchdog import alive

#: Time between two statements [s], as the stock diagnostic aggregator expects.
HEALTH_PERIOD = 1.0
#: Time since a node's last statement after which the next goes along with another node's [s].
SHARED_AFTER = 0.5
#: Time between two looks at readiness [s], which the start of a run waits for.
CHECK_PERIOD = 0.05
#: Who listen to the health of one graph alone. Where more do, there are more graphs, all of whose
#: nodes ask the middleware, which looks through what it knows of all of them: they ask less often.
LISTENERS = 3
#: Time after its start in which a node does not ask who lacks [s]: all nodes of a fleet would.
MEETING_TIME = 5.0
#: Time between telling of the end and ending [s], so that the telling arrives.
LINGER = 0.3


class NodePart:
    """What a node is composed of: tells its health with that of its node, and ends with it."""

    #: Longest time that a process waits for `quiet` when it is told to stop [s].
    patience = 0.0

    @property
    def quiet(self) -> bool:
        """Whether nothing is under way that others wait for."""
        return True

    def health(self) -> dict[str, Any]:
        """Values for `/diagnostics`, by name."""
        return {}

    def complaint(self) -> str:
        """What a person should look at, in a sentence; "" when all is well."""
        return ""

    def halt(self) -> None:
        """Begin no new work: the process has been told to stop."""


class Situation(NamedTuple):
    """What is told at once when it changes."""

    ready: bool = False
    rivals: str = ""
    finished: bool = False


class HealthReport:
    """Tells the health of a node on `/diagnostics`: once a second, and at once when it matters."""

    def __init__(self, node: LdtNode) -> None:
        self._node, self._topics = node, node.topics
        self._name = f"{node.get_namespace().strip('/')}/{node.role}".lstrip("/")
        self._publisher = node.create_publisher(DiagnosticArray, HEALTH_TOPIC, qos(HEALTH_TOPIC))
        #: Those of other nodes of this process, which go into the same message.
        self.others: Sequence[HealthReport] = ()
        self._seen: tuple[int, ...] = ()
        self._looked_at = 0.0
        self._told: Situation | None = None
        self._met = False
        self._told_at = 0.0
        self._told_to = 0
        self._began = time.monotonic()
        node.create_timer(CHECK_PERIOD, self._check, clock=node.steady)

    @property
    def end_is_told(self) -> bool:
        """Whether the node has finished, and others have had time to hear it."""
        told = self._told is not None and self._told.finished
        return told and time.monotonic() - self._told_at > LINGER

    def tell(self) -> None:
        """Publish health now: others wait for what it says.

        With it goes that of the process's other nodes whose turn is soon: in a fleet, everybody
        hears everybody, and a message costs more than what it says.
        """
        now = time.monotonic()
        soon = (o for o in self.others if not o._node.finished and now - o._told_at > SHARED_AFTER)
        message = DiagnosticArray(status=[report._status(now) for report in (self, *soon)])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)
        alive()

    def _check(self) -> None:
        now = time.monotonic()
        listeners = self._publisher.get_subscription_count()
        patience = CHECK_PERIOD * max(1.0, listeners / LISTENERS)
        situation = self._situation(now, patience)
        new = listeners != self._told_to and now - self._told_at >= min(patience, HEALTH_PERIOD)
        if situation == self._told and not new and now - self._told_at < HEALTH_PERIOD:
            return
        if situation.rivals and situation.rivals != (self._told.rivals if self._told else None):
            if self._topics.rivals.alarms:
                self._node.get_logger().error(situation.rivals)
            else:
                self._node.get_logger().warning(situation.rivals)
        self._told = situation
        self._met = self._met or situation.ready
        self.tell()

    def _situation(self, now: float, patience: float) -> Situation:
        """Whether all have met, and what is to be said of rivals, as of a moment ago.

        The graph is asked at once when somebody was met or lost, else after some patience; and once
        all have met, as rarely as health is told.
        """
        finished, seen = self._node.finished, self._topics.matched
        told = self._told or Situation()
        longest = HEALTH_PERIOD if told.ready else patience
        if seen == self._seen and now - self._looked_at < longest:
            return told._replace(finished=finished)
        self._seen, self._looked_at = seen, now
        self._topics.rivals.look()
        return Situation(self._topics.ready, self._topics.rivals.complaint(), finished)

    def _status(self, now: float) -> DiagnosticStatus:
        self._told_at, self._told_to = now, self._publisher.get_subscription_count()
        node, topics = self._node, self._topics
        status = DiagnosticStatus(name=self._name, hardware_id=node.machine.name)
        status.level, status.message = self._verdict()
        values: dict[str, Any] = {READY: bool(self._told and self._told.ready)}
        values[FINISHED] = node.finished
        values[PROCESS] = os.getpid()
        if node.stopped:
            values[STOPPED] = True
        values |= node.health()
        values |= topics.rivals.health()
        values |= topics.links.counts
        values |= {f"received {t}": n for t, n in topics.counts.items()}
        # A copy: what works on a thread of its own may reject as well.
        values |= {f"{REJECTED}{kind}": n for kind, n in dict(topics.rejected).items()}
        if topics.last_rejection:
            values[LAST_REJECTION] = topics.last_rejection
        status.values = [KeyValue(key=k, value=_text(v)) for k, v in values.items()]
        return status

    def _verdict(self) -> tuple[bytes, str]:
        topics = self._topics
        found = [topics.rivals.complaint(), topics.links.complaint(), self._node.complaint()]
        if topics.rejected:
            found.append(f"{sum(topics.rejected.values())} messages rejected")
        sentence = "; ".join(filter(None, found))
        if sentence:
            level = DiagnosticStatus.ERROR if topics.rivals.alarms else DiagnosticStatus.WARN
            return level, sentence
        if self._told and self._told.ready:
            return DiagnosticStatus.OK, "running"
        words = "its peers have left" if self._met else "waiting for its peers"
        long = time.monotonic() - self._began > MEETING_TIME
        unseen = ", ".join(topics.unseen) if long else ""
        return DiagnosticStatus.OK, f"{words}: {unseen}" if unseen else words


class LdtNode(Node):
    """A node of the twin."""

    def __init__(self, role: str, *groups: str, **node_arguments: Any) -> None:
        super().__init__(role, **node_arguments)
        self.role = role
        self.settings = declare(self, *groups, "node", "resume", "place")
        self.machine = load_machine(self.settings["machine"])
        #: Set when the node has no more work, for nodes that end by themselves.
        self.finished = False
        #: Set when such a node was told to stop before it had finished.
        self.stopped = False
        #: Why the node cannot go on, for what does not happen within a callback.
        self.failure: Exception | None = None
        #: Time that passes whatever a simulated clock says.
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.recording = OwnRecording(
            RecordedRun(self.settings["resume"], self.get_namespace(), self.machine)
        )
        #: What the node is composed of, beside its topics and its report.
        self.parts: list[NodePart] = []
        self.topics = Topics(self, self.settings["graph"])
        self.report = HealthReport(self)

    def health(self) -> dict[str, Any]:
        """Values for `/diagnostics`, by name."""
        return {name: value for part in self.parts for name, value in part.health().items()}

    def complaint(self) -> str:
        """What a person should look at, in a sentence; "" when all is well."""
        return "; ".join(filter(None, [part.complaint() for part in self.parts]))

    def halt(self) -> None:
        """Begin no new work: the process has been told to stop."""
        for part in self.parts:
            part.halt()

    def close(self) -> None:
        """Finish work before the node is destroyed."""

    @property
    def patience(self) -> float:
        """Longest time that a process waits for `quiet` when it is told to stop [s]."""
        return max((part.patience for part in self.parts), default=0.0)

    @property
    def quiet(self) -> bool:
        """Whether nothing is under way that others wait for."""
        return all(part.quiet for part in self.parts)

    @property
    def ended(self) -> bool:
        """Whether it begins nothing more: it has finished, or was stopped before."""
        return self.finished or self.stopped


def _text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
