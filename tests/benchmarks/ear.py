"""A listener outside the graph, by whose clock a graph and bare nodes are timed alike."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any, Self

PATIENCE = 120.0  # s
SETTLE = 1.0  # s


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
        from ldt_ros.environment import prepare

        prepare()
        import rclpy
        from rclpy.experimental import EventsExecutor

        from ldt_ros.interfaces import LISTENER_DEPTH, listener_qos, message_type

        self._context: Any = rclpy.Context()
        rclpy.init(args=[], context=self._context)
        self._node = rclpy.create_node("ear", context=self._context)
        for topic in self.heard:
            quality = listener_qos(topic, LISTENER_DEPTH)
            hear = partial(self._hear, self.heard[topic])
            self._node.create_subscription(message_type(topic), topic, hear, quality, raw=True)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        return self

    def __exit__(self, *_: object) -> None:
        import rclpy

        self._node.destroy_node()
        self._executor.shutdown()
        rclpy.try_shutdown(context=self._context)

    def until(self, done: Callable[[], bool]) -> None:
        """Listen until something is so.

        Raises:
            TimeoutError: it is not, for long.
        """
        end = time.monotonic() + PATIENCE
        while not done():
            if time.monotonic() > end:
                raise TimeoutError(f"not within {PATIENCE:g} s")
            self._executor.spin_once(timeout_sec=0.01)

    def clear(self) -> None:
        """Let those leave who have ended, and forget what they said."""
        end = time.monotonic() + SETTLE
        self.until(lambda: time.monotonic() > end)
        for times in self.heard.values():
            times.clear()

    @staticmethod
    def _hear(times: list[float], _: bytes) -> None:
        times.append(time.perf_counter())
