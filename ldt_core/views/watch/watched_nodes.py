"""The nodes of a machine's graph, as they tell of themselves on `/diagnostics`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ldt_core.recording.node_status import NodeStatus, node_statuses

MOST_NODES = 30  # of one machine that are shown: a graph has fewer
MOST_CHARACTERS = 400  # of what one says, since a foreign message may be of any size
SILENT_AFTER = 5.0  # s: a node tells of itself each second
READY = "ready"  # key that every node of the graph tells; other drivers' statuses lack it


@dataclass(frozen=True)
class Told:
    """What a node said last, and when [s of the fleet's clock]."""

    status: NodeStatus
    warns: bool
    at: float


class Nodes:
    """The nodes of one machine by role."""

    def __init__(self) -> None:
        self.told: dict[str, Told] = {}
        #: Name of the machine, as the nodes have it.
        self.machine = ""

    def take(self, message: Any, namespace: str, now: float) -> bool:
        """A message of `/diagnostics`; whether it told anything of this machine."""
        levels = {s.name.strip("/"): (s.level, s.hardware_id) for s in message.status}
        found = False
        for status in node_statuses(message, namespace):
            role = status.role
            if READY not in status.values or (
                role not in self.told and len(self.told) >= MOST_NODES
            ):
                continue
            level, machine = levels[status.name]
            self.machine = machine[:MOST_CHARACTERS] or self.machine
            self.told[role] = Told(_cut(status), bool(_number(level)), now)
            found = True
        return found

    def silent(self, now: float) -> list[str]:
        """Roles that have not been heard of for long, and were not at an end."""
        return [r for r, told in sorted(self.told.items()) if self._gone(told, now)]

    def rows(self, now: float, live: bool) -> Iterator[dict[str, Any]]:
        """Each node in JSON types: what it said, what it refused, whether it is silent."""
        for role, told in sorted(self.told.items()):
            refused = "; ".join(f"{n} × {kind}" for kind, n in told.status.rejected.items())
            silent = live and self._gone(told, now)
            yield {
                "role": role,
                "message": told.status.message,
                "warns": told.warns or silent,
                "silent": int(now - told.at) if silent else None,
                "rejected": refused,
                "why": told.status.last_rejection,
            }

    def _gone(self, told: Told, now: float) -> bool:
        return now - told.at > SILENT_AFTER and not self._ended

    @property
    def _ended(self) -> bool:
        """Whether the source has said that it sends nothing more: then all may end."""
        return any(told.status.ended for told in self.told.values())


def _cut(status: NodeStatus) -> NodeStatus:
    values = {
        k[:MOST_CHARACTERS]: v[:MOST_CHARACTERS]
        for k, v in list(status.values.items())[:MOST_NODES]
    }
    return NodeStatus(status.name, status.message[:MOST_CHARACTERS], values)


def _number(level: Any) -> int:
    """ROS has one byte, a recording a number."""
    return level[0] if isinstance(level, bytes) else int(level)
