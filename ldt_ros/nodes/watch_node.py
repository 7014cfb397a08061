"""What the live page hears of the graph."""

from __future__ import annotations

from functools import partial
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy

import msgs_config
from ldt_core.base.errors import LdtError
from ldt_core.recording.codec import DECODERS
from ldt_core.recording.node_status import HEALTH_TOPIC
from ldt_core.views.watch.fleet import MACHINES, Fleet
from ldt_ros.nodes.interfaces import LISTENER_DEPTH, from_message, listener_qos, message_type

#: Time between two looks for new machines [s].
LOOK_PERIOD = 0.3
STREAM = "joint_states"
STREAM_TYPE = msgs_config.topics()[STREAM]["type"]
#: Machines whose samples are heard: each has a hundred a second or more.
MOST_STREAMS = 4
TOPICS = {t: d["type"] for t, d in msgs_config.topics().items() if t in DECODERS}


class WatchNode(Node):
    """Subscribes to all topics of each machine that it finds, and publishes nothing.

    | received | what happens |
    |---|---|
    | any topic of a machine | shown |
    | its samples, where it streams them | the last seconds shown, of the first machines that do |
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
        self.streaming: set[str] = set()
        if self.only:
            self.follow(self.only)
        self._look()
        # A clock that runs whatever a simulated one says.
        self.create_timer(LOOK_PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

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
            if self.only and namespace != self.only:
                continue
            if topic == STREAM and STREAM_TYPE in kinds:
                self._listen(namespace, name)
            ours = TOPICS.get(topic) in kinds and namespace not in self.found
            if ours and len(self.found) < MACHINES and self.count_publishers(name):
                self.follow(namespace)

    def _listen(self, namespace: str, name: str) -> None:
        """Hear the samples of a machine that is followed, if there are not too many already."""
        fresh = namespace in self.found and namespace not in self.streaming
        if fresh and len(self.streaming) < MOST_STREAMS and self.count_publishers(name):
            self.streaming.add(namespace)
            profile = listener_qos(STREAM, LISTENER_DEPTH)
            # Whoever looks holds nobody up: what is lost on the way is not sent again.
            profile.reliability = ReliabilityPolicy.BEST_EFFORT
            take = partial(self._sample, namespace)
            self.create_subscription(message_type(STREAM), name, take, profile)

    def _sample(self, namespace: str, message: Any) -> None:
        if len(message.velocity):
            stamp = message.header.stamp
            moment = stamp.sec + stamp.nanosec / 1e9
            self.fleet.sample(namespace, moment, float(message.velocity[0]))

    def _take(self, namespace: str, topic: str, message: Any) -> None:
        try:
            record = from_message(topic, message)
        except LdtError as error:
            self.fleet.misread(namespace, str(error))
        else:
            self.fleet.feed(namespace, topic, record)
