"""Two processes that try to exchange a message as the nodes of a graph do.

`voice` speaks until it is ended; `ear` listens, looks round in the domain, and tells what it met.
"""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING, Any

import msgs_config
from ldt_ros.graph.environment import begin, prepare
from ldt_ros.graph.secure import dds_library
from ldt_ros.graph.trial_process import conduct

if TYPE_CHECKING:
    from rclpy.node import Node

NODE_PREFIX = "ldt_doctor"  # of all probes, so that they do not report each other
DISCOVERY_TIME = 0.6  # s; others are met within 0.25 s
MESSAGE_TIMEOUT = 7.0  # s for the message
SPIN = 0.02  # s


def main(role: str, topic: str) -> dict[str, Any]:
    """Be one of the two; what the ear met."""
    prepare()
    import rclpy

    begin(rclpy.get_default_context())
    node = rclpy.create_node(
        f"{NODE_PREFIX}_{role}_{os.getpid()}", enable_rosout=False, start_parameter_services=False
    )
    return _speak(node, topic) if role == "voice" else _listen(node, topic)


def _speak(node: Node, topic: str) -> dict[str, Any]:
    from std_msgs.msg import String

    publisher = node.create_publisher(String, topic, 10)
    end = time.monotonic() + MESSAGE_TIMEOUT
    while time.monotonic() < end:
        publisher.publish(String(data=repr(time.monotonic())))
        time.sleep(SPIN)
    return {}


def _listen(node: Node, topic: str) -> dict[str, Any]:
    from rclpy.experimental import EventsExecutor
    from rclpy.utilities import get_rmw_implementation_identifier
    from std_msgs.msg import String

    delays: list[float] = []

    def hear(message: String) -> None:
        delays.append(time.monotonic() - float(message.data))

    node.create_subscription(String, topic, hear, 10)
    executor = EventsExecutor()
    executor.add_node(node)
    began = time.monotonic()
    while (passed := time.monotonic() - began) < MESSAGE_TIMEOUT:
        executor.spin_once(timeout_sec=SPIN)
        if delays and passed > DISCOVERY_TIME:
            break
    return {
        "received": len(delays),
        "delay_s": min(delays, default=None),
        "rmw": get_rmw_implementation_identifier(),
        "nodes": _others(node),
        "publishers": _publishers(node),
        "middleware": dds_library(),
    }


def _others(node: Node) -> list[str]:
    """Nodes of this domain that are nobody's probe, by their full names."""
    met = node.get_node_names_and_namespaces()
    others = ((name, space) for name, space in met if not name.startswith(NODE_PREFIX))
    return sorted(f"{space.rstrip('/')}/{name}" for name, space in others)


def _publishers(node: Node) -> list[str]:
    """Topics of ours, in whatever namespace, that somebody publishes."""
    ours = {t for t in msgs_config.topics() if not t.startswith("/")}
    there = (topic for topic, _ in node.get_topic_names_and_types())
    return [t for t in there if t.rpartition("/")[2] in ours and node.count_publishers(t)]


if __name__ == "__main__":
    conduct(main)
