"""What a node of the graph tells of itself on `/diagnostics`: its words, and who reads them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

HEALTH_TOPIC = "/diagnostics"
READY = "ready"  # key that every node of a twin tells, and nobody else
PROCESS = "process"  # key; its id, which another graph's of the same name does not have
FINISHED = "finished"  # key; of a source: it has nothing more to send
STOPPED = "stopped"  # key; it was told to end before it had finished
REJECTED = "rejected "  # how the keys begin under which a node counts what it refused
LEFT_OUT = "left out, "  # the same, for samples that became part of no experiment
WRONG_STREAM = "wrong with the stream"  # key of a segmenter: what its user can mend
WRONG_RECORDING = "wrong with the recording"  # key of a recorder that cannot write now: why
LITTLE_ROOM = "little room"  # key of a recorder whose disk is nearly full: how much there is
INTERRUPTIONS = "interruptions"  # key of a recorder: how often it could not write
LAST_INTERRUPTION = "last interruption"  # why, the last time
LAST_REJECTION = "last rejection"
REFUSED = "refused experiment"  # key of the twin: there will be no prediction of it
RESUMED_AT = "resumed at"  # key of a source: end of the last experiment recorded before [s]
SECOND_PUBLISHER = "second publisher of "  # how the keys begin under which an alarm is counted
LIFELESS = "times lifeless, "  # the same, of topics whose publisher was killed, stopped, cut off
UNMATCHED = "not matched, "  # the same, of those at the other end whose QoS does not fit
DIGITS = 16  # of a number, which a double has to hold; anybody may say more


@dataclass(frozen=True)
class NodeStatus:
    """One statement of a node.

    Args:
        name: with the machine's namespace ("press/twin").
        message: its state in words.
        values: all that it told, by key.
        warns: whether a person should look at it.
    """

    name: str
    message: str
    values: Mapping[str, str]
    warns: bool = False

    @property
    def machine(self) -> str:
        """Namespace of its machine, "" for the root."""
        return self.name.rpartition("/")[0]

    @property
    def role(self) -> str:
        """Its name below the machine's namespace."""
        return self.name.rpartition("/")[2]

    @property
    def finished(self) -> bool:
        """Whether it has nothing more to do."""
        return self.values.get(FINISHED) == "true"

    @property
    def ended(self) -> bool:
        """Whether nothing more comes from it: it has finished, or was stopped before."""
        return self.finished or self.values.get(STOPPED) == "true"

    @property
    def process(self) -> int | None:
        """Id of the process that it is in."""
        return self.number(PROCESS)

    @property
    def rejected(self) -> dict[str, int]:
        """Topic and kind of error → messages refused since the node began."""
        return {
            key.removeprefix(REJECTED): count
            for key in self.values
            if key.startswith(REJECTED) and (count := self.number(key)) is not None
        }

    @property
    def interruption(self) -> str:
        """Why a recorder could not write, the last time; "" when it always could."""
        return self.values.get(LAST_INTERRUPTION, "")

    @property
    def last_rejection(self) -> str:
        """Why, the last time; "" when nothing was refused."""
        return self.values.get(LAST_REJECTION, "")

    def number(self, key: str) -> int | None:
        """A whole number from 0 that it told under this key; None where it told none."""
        text = self.values.get(key, "")
        return int(text) if text.isdecimal() and len(text) < DIGITS else None


def node_statuses(message: Any, namespace: str | None = None) -> Iterator[NodeStatus]:
    """Statements of one machine's nodes, or of all, in a message of `/diagnostics`.

    Args:
        message: DiagnosticArray of ROS or of a recording; of what is none nothing comes.
        namespace: of the machine's topics, with or without slashes at its ends; None for all.
    """
    machine = None if namespace is None else namespace.strip("/")
    for status in getattr(message, "status", ()):
        name = status.name.strip("/")
        if machine is None or name.rpartition("/")[0] == machine:
            values = {v.key: v.value for v in status.values}
            yield NodeStatus(name, status.message, values, is_warning(status.level))


def is_warning(level: bytes | int) -> bool:
    """Whether the level of a status is more than OK: a byte in ROS, a number in a recording."""
    return any(level) if isinstance(level, bytes) else bool(int(level))
