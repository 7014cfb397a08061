"""The start of a run: when all nodes of its graph have found each other."""

from __future__ import annotations

from collections.abc import Callable

from ldt_core.recording.node_status import READY, NodeStatus
from ldt_ros.nodes.node import LdtNode
from ldt_ros.nodes.statements import hear


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
        others = {r for r in self._node.settings["graph"] if r != self._node.role}
        return others <= self._ready and self._node.topics.ready

    def _on_statement(self, told: NodeStatus) -> None:
        if told.values.get(READY) == "true":
            self._ready.add(told.role)
        self._tell(told)
