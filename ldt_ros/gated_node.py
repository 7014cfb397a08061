"""A node that begins when all nodes of its graph have found each other."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from ldt_core.recording.node_status import HEALTH_TOPIC, NodeStatus, node_statuses
from ldt_ros.interfaces import qos
from ldt_ros.node import TwinNode


class GatedNode(TwinNode):
    """Knows by `/diagnostics` which of its machine's nodes have told that they are ready."""

    def __init__(self, role: str, *groups: str, **node_arguments: Any) -> None:
        super().__init__(role, *groups, **node_arguments)
        self._ready_peers: set[str] = set()
        self.create_subscription(DiagnosticArray, HEALTH_TOPIC, self._on_health, qos(HEALTH_TOPIC))

    @property
    def started(self) -> bool:
        """Whether the first experiment may be sent."""
        others = {r for r in self.settings["graph"] if r != self.role}
        return self.ready and others <= self._ready_peers

    def hear(self, told: NodeStatus) -> None:
        """Act on what a node of the graph told; for kinds of this node."""

    def _on_health(self, message: DiagnosticArray) -> None:
        for told in node_statuses(message, self.get_namespace()):
            if told.values.get("ready") == "true":
                self._ready_peers.add(told.role)
            self.hear(told)
