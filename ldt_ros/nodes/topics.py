"""A node's publishers and subscriptions, and what became of the messages on them."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_policy_name_from_kind
from rclpy.subscription import Subscription

import msgs_config
from ldt_core.base.errors import reason_of
from ldt_core.base.printable import one_line
from ldt_core.recording.node_status import LIFELESS, SECOND_PUBLISHER, UNMATCHED
from ldt_ros.nodes.interfaces import listener_qos, message_type, qos

#: Time after which a killed node's topics are gone [s]; its lease is 5 (msgs_config/fastdds.xml).
LEASE = 6.0
#: Topics on which a message moves the twin.
GUARDED = ("experiment", "model")
#: Name of a publisher that is met before its node.
UNKNOWN = "_NODE_NAME_UNKNOWN_"


class TopicLinks:
    """What the middleware tells of a node's topics: who no longer lives, and who does not fit.

    Its events come by the executor as messages do. A publisher says in time that it lives, from a
    thread of the middleware's own: one that is killed, stopped or cut off is noticed after its
    lease; one whose Python hangs is not, but its health no longer comes. A listener hears of it
    only where it asks for a lease itself, and is then not matched by publishers that promise none:
    only nodes of one graph ask each other for it.
    """

    def __init__(self, node: Node, inputs: Mapping[str, Subscription]) -> None:
        self._node, self._inputs = node, inputs
        #: What happened → how often.
        self.counts: Counter[str] = Counter()
        #: Topic → whether somebody who publishes it lives, once one has said so.
        self.alive: dict[str, bool] = {}
        self._policies: dict[str, str] = {}  # of publishers that are there and cannot be heard

    def of_input(self, topic: str) -> SubscriptionEventCallbacks:
        """What a subscription calls."""

        def liveliness(event: Any) -> None:
            if event.alive_count > 0:
                self.heard(topic)
                self.alive[topic] = True
            elif event.not_alive_count_change > 0:
                self.alive[topic] = False
                self.counts[f"{LIFELESS}{topic}"] += 1
                self._node.get_logger().warning(_lifeless(topic))

        def incompatible(event: Any) -> None:
            policy = qos_policy_name_from_kind(event.last_policy_kind).lower()
            self._policies[topic] = policy
            self.counts[f"{UNMATCHED}{topic}"] += event.total_count_change or 1
            self._node.get_logger().warning(f"a publisher of {_misfit(topic, policy)}")

        return SubscriptionEventCallbacks(liveliness=liveliness, incompatible_qos=incompatible)

    def of_output(self, topic: str) -> PublisherEventCallbacks:
        """What a publisher calls: somebody asks for more than is offered, and hears nothing."""

        def incompatible(event: Any) -> None:
            policy = qos_policy_name_from_kind(event.last_policy_kind).lower()
            self.counts[f"{UNMATCHED}{topic}"] += event.total_count_change or 1
            self._node.get_logger().warning(
                f"a listener to {topic} asks for {policy} that is not offered, and hears nothing"
            )

        return PublisherEventCallbacks(incompatible_qos=incompatible)

    def heard(self, topic: str) -> None:
        """A message is a sign of life too; that of the middleware does not come back each time."""
        if not self.alive.get(topic, True):
            self.alive[topic] = True
            self._node.get_logger().info(f"{topic} is heard again")

    def complaint(self) -> str:
        """What is wrong now; "" when nothing is."""
        found = [_lifeless(topic) for topic, alive in sorted(self.alive.items()) if not alive]
        for topic, policy in sorted(self._policies.items()):
            # That it has gone there is no event for.
            if self._node.count_publishers(topic) > self._inputs[topic].get_publisher_count():
                found.append(f"a publisher of {_misfit(topic, policy)}")
        return "; ".join(found)


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


class Topics:
    """Declared topics of a node.

    A message that cannot be used is counted and logged once per kind, and the node goes on.
    """

    def __init__(self, node: Node, graph: Iterable[str]) -> None:
        self._node, self._graph = node, set(graph)
        #: Messages that have come, by topic.
        self.counts: Counter[str] = Counter()
        #: Messages that could not be used, by topic and kind of error.
        self.rejected: Counter[str] = Counter()
        self.last_rejection = ""
        self._outputs: dict[str, Publisher] = {}
        self._inputs: dict[str, Subscription] = {}
        self.rivals = Rivals(node, self._outputs, self._inputs)
        self.links = TopicLinks(node, self._inputs)

    def publishes(self, topic: str) -> Publisher:
        """A publisher of a declared topic."""
        self._outputs[topic] = self._node.create_publisher(
            message_type(topic), topic, qos(topic), event_callbacks=self.links.of_output(topic)
        )
        return self._outputs[topic]

    def listens(
        self, topic: str, callback: Callable[[Any], None], *, raw: bool = False, depth: int = 0
    ) -> None:
        """Subscribe to a declared topic; whatever the callback raises is counted, and ends nothing.

        A second time it is in place of the first.
        """
        if topic in self._inputs:
            self._node.destroy_subscription(self._inputs.pop(topic))

        def guarded(message: Any) -> None:
            try:
                self.counts[topic] += 1
                self.links.heard(topic)
                callback(message)
            except BaseException as error:  # signals raise nothing in a node's process
                self.reject(topic, error)

        self._inputs[topic] = self._node.create_subscription(
            message_type(topic),
            topic,
            guarded,
            self._listener_qos(topic, depth),
            raw=raw,
            event_callbacks=self.links.of_input(topic),
        )

    def _listener_qos(self, topic: str, depth: int) -> QoSProfile:
        """What was missed, and signs of life, are asked for alone of nodes of this graph.

        They keep the one and give the other; a machine of the user's may not. Who was started
        again, or cut off from another host for a while, has missed something. From one
        subscription: of two, one would hear the present before the other hears the past.
        """
        ours = self._graph & set(msgs_config.topics()[topic]["publisher"])
        return listener_qos(topic, depth, own=bool(ours))

    def reject(self, topic: str, error: BaseException) -> None:
        """Count a message that cannot be used; log the first of its kind."""
        kind = f"{topic}: {type(error).__name__}"
        self.rejected[kind] += 1
        reason = reason_of(error)
        names_it = reason.startswith(tuple(topic + mark for mark in ":.,"))
        self.last_rejection = reason if names_it else f"{topic}: {reason}"
        if self.rejected[kind] == 1:
            self._node.get_logger().error(f"rejected a message on {self.last_rejection}")

    @property
    def matched(self) -> tuple[int, ...]:
        """How many there are at the other end of each; cheap enough to be asked all the time."""
        outputs, inputs = self._outputs.values(), self._inputs.values()
        return (*map(_matched, outputs), *map(_matched, inputs))

    @property
    def ready(self) -> bool:
        """Whether every topic has met the peers that the graph has for it."""
        ends = self._ends()
        # Numbers first: to ask for names means to go through the whole graph.
        if any(matched < len(wanted) for matched, wanted, _, _ in ends):
            return False
        for matched, wanted, ask, topic in ends:
            found = [info.node_name for info in ask(topic)]
            # Being seen in the graph comes before being matched; only the latter gets messages.
            if matched < len(found) or not wanted <= set(found):
                return False
        return True

    @property
    def unseen(self) -> list[str]:
        """Nodes of the graph that a topic needs and that are not there; costs as `ready` does."""
        found: set[str] = set()
        for _, wanted, ask, topic in self._ends():
            if wanted:
                found |= wanted - {info.node_name for info in ask(topic)}
        return sorted(found)

    def _ends(self) -> list[tuple[int, set[str], Callable[[str], list[Any]], str]]:
        """Of each topic: how many are met, who should be, what asks for their names, the topic."""
        table, node = msgs_config.topics(), self._node
        kinds: tuple[tuple[Mapping[str, Any], str, Callable[[str], list[Any]]], ...] = (
            (self._outputs, "subscriber", node.get_subscriptions_info_by_topic),
            (self._inputs, "publisher", node.get_publishers_info_by_topic),
        )
        return [
            (_matched(end), self._graph & set(table[topic][peers]), ask, topic)
            for ends, peers, ask in kinds
            for topic, end in ends.items()
        ]


def _matched(end: Publisher | Subscription) -> int:
    if isinstance(end, Publisher):
        return end.get_subscription_count()
    return end.get_publisher_count()


def _lifeless(topic: str) -> str:
    return f"no sign of life of who publishes {topic}"


def _misfit(topic: str, policy: str) -> str:
    return f"{topic} offers less {policy} than is asked for, and is not heard"
