"""What the nodes of one machine tell of themselves, among those of all machines of a domain."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from ldt_core.recording.node_status import HEALTH_TOPIC, READY, NodeStatus, node_statuses
from ldt_ros.nodes.interfaces import qos
from ldt_ros.nodes.node import LdtNode


def concerns(data: bytes, namespace: str) -> bool:
    """Whether a serialised message of `/diagnostics` may be about a machine.

    It is about another one if nodes of a twin tell something in it, and none of this namespace's.
    To see that costs a hundredth of reading the message, which in a fleet everybody gets.
    """
    machine = namespace.strip("/")
    return not machine or f"{machine}/".encode() in data or READY.encode() not in data


def hear(node: Node, of: Mapping[str, Callable[[NodeStatus], None]]) -> None:
    """Subscribe to what the nodes of machines tell; what cannot be read is nobody's statement.

    Args:
        node: that listens.
        of: namespace of a machine → called with each statement of its nodes.
    """
    callbacks = {namespace.strip("/"): callback for namespace, callback in of.items()}

    def take(data: bytes) -> None:
        if not any(concerns(data, machine) for machine in callbacks):
            return
        try:
            message = deserialize_message(data, DiagnosticArray)
        except (RuntimeError, ValueError):  # rclpy's own are kinds of the first
            return
        for told in node_statuses(message):
            if told.machine in callbacks:
                callbacks[told.machine](told)

    node.create_subscription(DiagnosticArray, HEALTH_TOPIC, take, qos(HEALTH_TOPIC), raw=True)


class StartGate:
    """Knows by `/diagnostics` which of its machine's nodes have told that they are ready.

    Args:
        node: that begins then.
        told: is called with what each node of the machine tells.
    """

    def __init__(self, node: LdtNode, told: Callable[[NodeStatus], None]) -> None:
        self._node, self._tell = node, told
        self._ready: set[str] = set()
        hear(node, {node.get_namespace(): self._on_statement})

    @property
    def is_open(self) -> bool:
        """Whether the first experiment may be sent."""
        return not self.missing and self._node.topics.ready

    @property
    def missing(self) -> list[str]:
        """Nodes of the graph that have not told yet that they are ready."""
        return sorted({*self._node.settings["graph"]} - {self._node.role} - self._ready)

    def _on_statement(self, told: NodeStatus) -> None:
        if told.values.get(READY) == "true":
            self._ready.add(told.role)
        self._tell(told)
