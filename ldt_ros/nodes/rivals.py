"""More than one publisher of a topic of the graph: who they are, and when that is an alarm."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from typing import Any

from rclpy.node import Node

from ldt_core.base.printable import one_line
from ldt_core.recording.node_status import SECOND_PUBLISHER

#: Time after which a killed node's topics are gone [s]; its lease is 5 (msgs_config/fastdds.xml).
LEASE = 6.0
#: Topics on which a message moves the twin.
GUARDED = ("experiment", "model")
#: Name of a publisher that is met before its node.
UNKNOWN = "_NODE_NAME_UNKNOWN_"


class Rivals:
    """Watches over the publishers of a node's topics.

    Two of `experiment` or `model` are an alarm: at once where their nodes have different names,
    else once the one can no longer be what a killed node has left while it starts again.
    """

    def __init__(self, node: Node, outputs: Mapping[str, Any], inputs: Mapping[str, Any]) -> None:
        self._node, self._outputs, self._inputs = node, outputs, inputs
        #: Topic → how often the alarm has been raised.
        self.raised: Counter[str] = Counter()
        #: Topic → the nodes that publish it, where there is an alarm now.
        self.alarms: dict[str, str] = {}
        #: Topics with more than one publisher.
        self.topics: list[str] = []
        #: Further topics, of which a node finds by itself that they have more than one.
        self.further: set[str] = set()
        self._since: dict[str, float] = {}

    def look(self) -> None:
        """Bring `topics` and `alarms` up to date."""
        shared = [t for t in (*self._outputs, *self._inputs) if not t.startswith("/")]
        shared = [t for t in shared if self._node.count_publishers(t) > 1]
        self.topics = [*shared, *sorted(self.further)]
        found = {t: names for t in self.topics if t in GUARDED and (names := self._alarm(t))}
        for topic in found.keys() - self.alarms.keys():
            self.raised[topic] += 1
        self.alarms = found
        self._since = {t: began for t, began in self._since.items() if t in self.topics}

    def health(self) -> dict[str, int]:
        """How often each alarm has been raised, for `/diagnostics`."""
        return {f"{SECOND_PUBLISHER}{topic}": count for topic, count in self.raised.items()}

    def complaint(self) -> str:
        """What is to be said of them; "" when there are none."""
        told = (f"{t} ({self.alarms[t]})" if t in self.alarms else t for t in self.topics)
        return f"more than one publisher of {', '.join(told)}" if self.topics else ""

    def _alarm(self, topic: str) -> str:
        """The names of a topic's publishers if two are an alarm, else ""."""
        now = time.monotonic()
        since = self._since.setdefault(topic, now)
        infos = self._node.get_publishers_info_by_topic(topic)
        names = [f"{i.node_namespace.rstrip('/')}/{i.node_name}" for i in infos]
        known = {n for n in names if not n.endswith(UNKNOWN)}
        late = len(names) > 1 and now - since > LEASE
        return one_line(", ".join(sorted(names))) if len(known) > 1 or late else ""
