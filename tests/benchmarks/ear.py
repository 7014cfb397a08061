"""A machine outside the graph, by whose clock a graph and bare nodes are timed alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, Self

PATIENCE = 120.0  # s
LOST = 2.0  # s after which an answer never comes
SETTLE = 1.0  # s
SPIN = 0.01  # s


class Ear:
    """A context; a node that notes when messages come, without decoding them.

    Args:
        topics: declared ones.

    Attributes:
        heard: topic → when each of its messages came, by `time.perf_counter`.
    """

    def __init__(self, *topics: str) -> None:
        self.heard: dict[str, list[float]] = {topic: [] for topic in topics}

    def __enter__(self) -> Self:
        from ldt_ros.graph.environment import prepare

        prepare()
        import rclpy
        from rclpy.experimental import EventsExecutor

        from ldt_ros.nodes.interfaces import LISTENER_DEPTH, listener_qos, message_type

        self._context: Any = rclpy.Context()
        rclpy.init(args=[], context=self._context)
        self.node = rclpy.create_node("ear", context=self._context)
        for topic in self.heard:
            quality = listener_qos(topic, LISTENER_DEPTH)
            hear = partial(self._hear, self.heard[topic])
            self.node.create_subscription(message_type(topic), topic, hear, quality, raw=True)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self.node)
        return self

    def __exit__(self, *_: object) -> None:
        import rclpy

        self.node.destroy_node()
        self._executor.shutdown()
        rclpy.try_shutdown(context=self._context)

    def until(self, done: Callable[[], bool], patience: float = PATIENCE) -> None:
        """Listen until something is so.

        Raises:
            TimeoutError: it is not, for long.
        """
        end = time.monotonic() + patience
        while not done():
            if time.monotonic() > end:
                raise TimeoutError(f"not within {patience:g} s")
            self._executor.spin_once(timeout_sec=SPIN)

    def clear(self) -> None:
        """Let those leave who have ended, and forget what they said."""
        end = time.monotonic() + SETTLE
        self.until(lambda: time.monotonic() > end)
        for times in self.heard.values():
            times.clear()

    def exchange(
        self, publisher: Any, listeners: int, messages: Iterable[Any], period: float = 0.0
    ) -> dict[str, list]:
        """Send message by message, each after the answers to the one before.

        Args:
            publisher: of this node.
            listeners: that it waits for first.
            messages: to be sent.
            period: least time from one to the next [s].

        Returns:
            Topic → how long each of its answers took [s].
        """
        self.until(lambda: publisher.get_subscription_count() >= listeners)
        self.until(lambda: all(self.node.count_publishers(t) for t in self.heard))
        self.clear()  # discovered is not yet matched
        took: dict[str, list] = {topic: [] for topic in self.heard}
        for message in messages:
            for times in self.heard.values():
                times.clear()
            began = time.perf_counter()
            publisher.publish(message)
            try:
                self.until(lambda: all(self.heard.values()), LOST)
            except TimeoutError:
                continue
            for topic, times in self.heard.items():
                took[topic].append(times[0] - began)
            end = began + period
            self.until(lambda end=end: time.perf_counter() >= end)
        return took

    @staticmethod
    def _hear(times: list[float], _: bytes) -> None:
        times.append(time.perf_counter())
