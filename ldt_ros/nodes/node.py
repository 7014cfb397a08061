"""What all nodes of the graph share: parameters, topics, health, and an end in order."""

from __future__ import annotations

from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.node_status import FINISHED, STOPPED
from ldt_core.restart.recorded_run import RecordedRun
from ldt_ros.nodes.health_report import HealthReport
from ldt_ros.nodes.interfaces import declare
from ldt_ros.nodes.node_part import NodePart
from ldt_ros.nodes.own_recording import OwnRecording
from ldt_ros.nodes.topics import Topics


class LdtNode(Node):
    """A node of the twin.

    Args:
        role: name of the node (`plant`, `twin`, …).
        groups: parameter groups that it declares.
    """

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
        self.report = HealthReport(
            self,
            f"{self.get_namespace().strip('/')}/{role}".lstrip("/"),
            self.steady,
            self.topics,
            self.machine.name,
            self._values,
            self.complaint,
            lambda: self.finished,
        )

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
    def done(self) -> bool:
        """Whether the node has finished, and others have had time to hear it."""
        return self.report.end_is_told

    @property
    def ended(self) -> bool:
        """Whether it begins nothing more: it has finished, or was stopped before."""
        return self.finished or self.stopped

    def _values(self) -> dict[str, Any]:
        stopped = {STOPPED: True} if self.stopped else {}
        return {FINISHED: self.finished, **stopped, **self.health()}
