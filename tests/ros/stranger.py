"""What the tests of the nodes share: a stranger in the graph who sends anything and hears all."""

from __future__ import annotations

import contextlib
import os
import time
import warnings
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

import msgs_config
from ldt_core.base.experiment import Action, Adaptation, Experiment, Level, Prediction, Signal
from ldt_core.recording.writer import BagWriter

# Every field of every message is checked; the message classes read this when they are imported.
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"

# The parser library behind rclpy's messages imports a deprecated module of Python's.
with warnings.catch_warnings(), contextlib.suppress(ImportError):
    warnings.simplefilter("ignore")
    import rosidl_generator_py  # noqa: F401

PATIENCE = 60.0  # s; a stalled machine is not what is tested
PERIOD, LENGTH = 0.01, 60  # s, samples: short experiments keep the tests fast


def experiment(number: int, voltage: float = 10.0, length: int = LENGTH) -> Experiment:
    """An experiment that the default machine can have made."""
    rest = np.zeros(length)
    return Experiment(number, 1e9 + 100 * number, PERIOD, rest + voltage, rest)


TOPICS = tuple(t for t in msgs_config.topics() if not t.startswith("/"))


def declared(topic: str) -> str:
    """A topic as it is declared, without its namespace."""
    return topic if topic.startswith("/") else topic.rpartition("/")[2]


class Stranger:
    """A node of nobody's, with the nodes under test in the same process, over real DDS.

    Args:
        namespace: of its topics.
    """

    def __init__(self, namespace: str = "") -> None:
        import rclpy
        from rclpy.experimental import EventsExecutor
        from rclpy.signals import SignalHandlerOptions

        self.context = rclpy.Context()
        rclpy.init(context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.executor = EventsExecutor(context=self.context)
        self.nodes: list[Any] = []
        self.heard: dict[str, list[Any]] = defaultdict(list)
        self.node = rclpy.create_node("stranger", context=self.context, namespace=namespace)
        self.executor.add_node(self.node)
        self.publishers: dict[str, Any] = {}

    def start(self, kind: type, namespace: str = "", **parameters: Any) -> Any:
        """A node under test with these parameters."""
        from rclpy.parameter import Parameter

        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        node = kind(context=self.context, namespace=namespace, parameter_overrides=overrides)
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def listen(self, *topics: str, profile: Any = None) -> None:
        """Collect what comes, decoded where it is a record, from now on (or from the start on)."""
        from ldt_ros.nodes.interfaces import message_type, qos

        for topic in topics:
            self.node.create_subscription(
                message_type(declared(topic)),
                topic,
                lambda message, topic=topic: self._hear(topic, message),
                profile or qos(declared(topic)),
            )
        if self.nodes:
            self.until(lambda: all(map(self.node.count_publishers, topics)), f"topics {topics}")

    def _hear(self, topic: str, message: Any) -> None:
        from ldt_ros.nodes.interfaces import from_message

        record = message if topic == "/diagnostics" else from_message(topic, message)
        self.heard[topic].append(record)

    def publisher(self, topic: str) -> Any:
        """A publisher that everyone who listens has met."""
        from ldt_ros.nodes.interfaces import message_type, qos

        kind = declared(topic)
        publisher = self.node.create_publisher(message_type(kind), topic, qos(kind))
        self.until(
            lambda: 0 < self.node.count_subscribers(topic) <= publisher.get_subscription_count(),
            f"a listener on {topic}",
        )
        self.spin(0.05)  # the other side of the match
        return publisher

    def send(self, topic: str, *messages: Any) -> None:
        """Publish messages, or records."""
        from ldt_ros.nodes.interfaces import to_message

        if topic not in self.publishers:
            self.publishers[topic] = self.publisher(topic)
        for message in messages:
            ready = hasattr(message, "get_fields_and_field_types")
            self.publishers[topic].publish(message if ready else to_message(message))

    def spin(self, seconds: float) -> None:
        """Let time pass."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.01)

    def until(self, condition: Any, what: str = "") -> Any:
        """Let time pass until the condition holds; its value."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if value := condition():
                return value
            self.executor.spin_once(timeout_sec=0.01)
        raise AssertionError(f"not within {PATIENCE:g} s: {what or condition}")

    def numbers(self, topic: str) -> list[int]:
        """Experiment numbers of what was heard on a topic, in its order."""
        return [getattr(r, "number", getattr(r, "experiment", None)) for r in self.heard[topic]]

    def health(self, name: str) -> dict[str, str]:
        """What a node told last in `/diagnostics`, with `level` and `message`."""
        for message in reversed(self.heard["/diagnostics"]):
            for status in message.status:
                if status.name == name:
                    values = {v.key: v.value for v in status.values}
                    return {**values, "level": status.level[0], "message": status.message}
        return {}

    def close(self) -> None:
        """End all nodes."""
        import rclpy

        for node in reversed(self.nodes):
            node.close()
            node.destroy_node()
        self.node.destroy_node()
        self.executor.shutdown()
        rclpy.try_shutdown(context=self.context)


def prediction(number: int, speed: float = 0.0, length: int = LENGTH) -> Prediction:
    return Prediction(number, 1e9 + 100 * number, PERIOD, 0, np.full(length, speed))


def answer(number: int, level: Level = Level.NEGATIVE) -> Signal:
    return Signal(number, level, "threshold", 0, 1.0)


def adaptation(number: int, version: int = 0) -> Adaptation:
    return Adaptation(number, Action.KEPT, version, "because")


def log_of(stranger: Stranger) -> list[Any]:
    """Whatever the nodes log from now on, and what those who live have logged."""
    from rcl_interfaces.msg import Log
    from rclpy.qos import QoSDurabilityPolicy, QoSProfile

    lines: list = []
    kept = QoSProfile(depth=100, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    ear = stranger.node.create_subscription(Log, "/rosout", lines.append, kept)
    loud = stranger.node.count_publishers
    stranger.until(lambda: ear.get_publisher_count() >= loud("/rosout"), "those who log")
    stranger.spin(0.1)
    return lines


def written(folder: Path, *numbers: int, voltages: dict[int, float] | None = None) -> str:
    """A recording of experiments."""
    with BagWriter(folder, machine="rotor") as writer:
        for number in numbers:
            record = experiment(number, (voltages or {}).get(number, 10.0))
            writer.write("experiment", record, record.end)
    return str(folder)
