"""What the middleware tells of a node's topics: who no longer lives, and who does not fit.

Its events come by the executor as messages do. A publisher says in time that it lives, from a
thread of the middleware's own: one that is killed, stopped or cut off is noticed after its lease;
one whose Python hangs is not, but its health no longer comes. A listener hears of it only where it
asks for a lease itself, and is then not matched by publishers that promise none: only nodes of one
graph ask each other for it.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import qos_policy_name_from_kind

from ldt_core.recording.node_status import LIFELESS, UNMATCHED


class TopicLinks:
    """Counts what happens to a node's topics, and says what is wrong now.

    Args:
        node: whose log tells of it.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        #: What happened → how often.
        self.counts: Counter[str] = Counter()
        #: Topic → whether somebody who publishes it lives, once one has said so.
        self.alive: dict[str, bool] = {}
        self._policies: dict[str, str] = {}  # of publishers that are there and cannot be heard
        self._inputs: dict[str, Any] = {}

    def of_input(self, topic: str) -> SubscriptionEventCallbacks:
        """What a subscription calls."""

        def liveliness(event: Any) -> None:
            if event.alive_count > 0:
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

    def add(self, topic: str, subscription: Any) -> None:
        """Take in the subscription whose events these are."""
        self._inputs[topic] = subscription

    def heard(self, topic: str) -> None:
        """A message is a sign of life too; that of the middleware does not come back each time."""
        if not self.alive.get(topic, True):
            self.alive[topic] = True

    def complaint(self) -> str:
        """What is wrong now; "" when nothing is."""
        found = [_lifeless(topic) for topic, alive in sorted(self.alive.items()) if not alive]
        for topic, policy in sorted(self._policies.items()):
            # That it has gone there is no event for.
            if self._node.count_publishers(topic) > self._inputs[topic].get_publisher_count():
                found.append(f"a publisher of {_misfit(topic, policy)}")
        return "; ".join(found)

    def health(self) -> dict[str, int]:
        """How often what happened, for `/diagnostics`."""
        return dict(self.counts)


def _lifeless(topic: str) -> str:
    return f"no sign of life of who publishes {topic}"


def _misfit(topic: str, policy: str) -> str:
    return f"{topic} offers less {policy} than is asked for, and is not heard"
