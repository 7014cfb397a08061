"""Two processes that try to exchange a message as the nodes of a graph do.

`python -m ldt_ros.graph.probe voice TOPIC PARENT` speaks until it is ended; `ear` instead of
`voice` listens, looks round in the domain, and prints what it met as JSON. They are processes of
their own because the middleware can end the process that loads it.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import msgs_config
from ldt_ros.graph.environment import begin, prepare
from ldt_ros.graph.parentage import end_with

OWN = "ldt_doctor"  # how the nodes of all probes begin, so that they do not report each other
LOOK_ROUND = 0.6  # s; others are met within 0.25 s
PATIENCE = 7.0  # s for the message
SPIN = 0.02  # s


def main(role: str, topic: str, parent: str) -> int:
    """Be one of the two."""
    if not end_with(int(parent), signal.SIGKILL):
        return 1
    prepare()
    import rclpy

    begin(rclpy.get_default_context())
    node = rclpy.create_node(
        f"{OWN}_{role}_{os.getpid()}", enable_rosout=False, start_parameter_services=False
    )
    if role == "voice":
        return _speak(node, topic)
    print(json.dumps(_listen(node, topic)), flush=True)
    return 0


def _speak(node: Any, topic: str) -> int:
    from std_msgs.msg import String

    publisher = node.create_publisher(String, topic, 10)
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        publisher.publish(String(data=repr(time.monotonic())))
        time.sleep(SPIN)
    return 0


def _listen(node: Any, topic: str) -> dict[str, Any]:
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
    while (passed := time.monotonic() - began) < PATIENCE:
        executor.spin_once(timeout_sec=SPIN)
        if delays and passed > LOOK_ROUND:
            break
    return {
        "received": len(delays),
        "delay_s": min(delays, default=None),
        "rmw": get_rmw_implementation_identifier(),
        "nodes": _others(node),
        "publishers": _publishers(node),
        "middleware": _middleware(),
    }


def _others(node: Any) -> list[str]:
    """Nodes of this domain that are nobody's probe, by their full names."""
    met = node.get_node_names_and_namespaces()
    return sorted(f"{space.rstrip('/')}/{name}" for name, space in met if not name.startswith(OWN))


def _publishers(node: Any) -> list[str]:
    """Topics of ours, in whatever namespace, that somebody publishes."""
    ours = {t for t in msgs_config.topics() if not t.startswith("/")}
    there = (topic for topic, _ in node.get_topic_names_and_types())
    return [t for t in there if t.rpartition("/")[2] in ours and node.count_publishers(t)]


def _middleware() -> str | None:
    """The file of the DDS library that this process has loaded."""
    for line in Path("/proc/self/maps").read_text().splitlines():
        path = line.rpartition(" ")[2]
        if Path(path).name.startswith(("libfastrtps.", "libfastdds.")):
            return path
    return None


if __name__ == "__main__":
    code = main(*sys.argv[1:])
    sys.stdout.flush()
    os._exit(code)
