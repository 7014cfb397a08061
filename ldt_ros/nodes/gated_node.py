"""A node that begins when all nodes of its graph have found each other."""

from __future__ import annotations

from typing import Any

from ldt_core.recording.node_status import READY, NodeStatus
from ldt_ros.nodes.node import TwinNode
from ldt_ros.nodes.statements import hear


class GatedNode(TwinNode):
    """Knows by `/diagnostics` which of its machine's nodes have told that they are ready."""

    def __init__(self, role: str, *groups: str, **node_arguments: Any) -> None:
        super().__init__(role, *groups, **node_arguments)
        self._ready_peers: set[str] = set()
        hear(self, {self.get_namespace(): self._on_statement})

    @property
    def started(self) -> bool:
        """Whether the first experiment may be sent."""
        others = {r for r in self.settings["graph"] if r != self.role}
        return others <= self._ready_peers and self.ready

    def hear(self, told: NodeStatus) -> None:
        """Act on what a node of the graph told; for kinds of this node."""

    def _on_statement(self, told: NodeStatus) -> None:
        if told.values.get(READY) == "true":
            self._ready_peers.add(told.role)
        self.hear(told)
