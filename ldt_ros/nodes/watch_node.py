"""What the live page hears of the graph."""

from __future__ import annotations

from functools import partial
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

import msgs_config
from ldt_core.base.errors import LdtError
from ldt_core.recording.codec import DECODERS
from ldt_core.recording.node_status import HEALTH_TOPIC
from ldt_core.views.watch.fleet import MACHINES, Fleet
from ldt_ros.nodes.interfaces import LISTENER_DEPTH, from_message, listener_qos, message_type

#: Time between two looks for new machines [s].
LOOK_PERIOD = 0.3
TOPICS = {t: d["type"] for t, d in msgs_config.topics().items() if t in DECODERS}


class WatchNode(Node):
    """Subscribes to all topics of each machine that it finds, and publishes nothing.

    | received | what happens |
    |---|---|
    | any topic of a machine | shown |
    | `/diagnostics` | shown by machine; nothing of nodes that are no machine's |
    | anything malformed | counted, and the last one told on the page |

    Args:
        fleet: is fed with what comes.
        namespace: of the one machine to watch; "" for all.
    """

    def __init__(self, fleet: Fleet, namespace: str = "", **node_arguments: Any) -> None:
        super().__init__("watch", start_parameter_services=False, **node_arguments)
        self.fleet, self.only = fleet, namespace.strip("/")
        self.found: set[str] = set()
        self.create_subscription(
            message_type(HEALTH_TOPIC),
            HEALTH_TOPIC,
            partial(fleet.feed, "", HEALTH_TOPIC),
            listener_qos(HEALTH_TOPIC, LISTENER_DEPTH),
        )
        if self.only:
            self.follow(self.only)
        else:
            self._look()
            # A clock that runs whatever a simulated one says.
            self.create_timer(
                LOOK_PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME)
            )

    def follow(self, namespace: str) -> None:
        """Watch the machine of a namespace, "" for the root."""
        self.found.add(namespace)
        self.fleet.expect(namespace)
        for topic in TOPICS:
            name = f"/{namespace}/{topic}" if namespace else f"/{topic}"
            take = partial(self._take, namespace, topic)
            profile = listener_qos(topic, LISTENER_DEPTH)
            self.create_subscription(message_type(topic), name, take, profile)

    def _look(self) -> None:
        """Follow what has one of our topics with its type, and somebody who publishes it."""
        for name, kinds in self.get_topic_names_and_types():
            namespace, _, topic = name.rpartition("/")
            namespace = namespace.strip("/")
            ours = TOPICS.get(topic) in kinds and namespace not in self.found
            if ours and len(self.found) < MACHINES and self.count_publishers(name):
                self.follow(namespace)

    def _take(self, namespace: str, topic: str, message: Any) -> None:
        try:
            record = from_message(topic, message)
        except LdtError as error:
            self.fleet.misread(namespace, str(error))
        else:
            self.fleet.feed(namespace, topic, record)
