"""Tries to publish and to hear every topic of a graph's loop, and says how far it came.

python insider.py NAME SECONDS

Whether with a key, and with whose, its environment says. Prints when the time is over what it could
not create, whom it was matched with, and what it heard: one JSON object.
"""

from __future__ import annotations

import json
import os
import sys
import time

from ldt_core.restart.recorded_run import LOOP
from ldt_ros.graph.environment import prepare


def main(name: str, seconds: float) -> None:
    """Try, and tell."""
    prepare()
    import rclpy

    from ldt_ros.nodes.interfaces import message_type, qos

    rclpy.init()
    node = rclpy.create_node(name)
    refused: dict[str, list[str]] = {"publishes": [], "hears": []}
    heard: set[str] = set()
    publishers, subscriptions = {}, {}
    for topic in LOOP:
        kind, profile = message_type(topic), qos(topic)
        try:
            publishers[topic] = node.create_publisher(kind, topic, profile)
        except Exception:
            refused["publishes"].append(topic)
        try:
            subscriptions[topic] = node.create_subscription(
                kind, topic, lambda _, topic=topic: heard.add(topic), profile
            )
        except Exception:
            refused["hears"].append(topic)
    reached: set[str] = set()
    met: set[str] = set()
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for topic, publisher in publishers.items():
            own = topic in subscriptions
            if publisher.get_subscription_count() > own:
                reached.add(topic)
            met |= {i.node_name for i in node.get_publishers_info_by_topic(topic)}
        if "model" in publishers:
            publishers["model"].publish(message_type("model")(data="{}"))
        rclpy.spin_once(node, timeout_sec=0.02)
    own_messages = {"model"} if "model" in publishers else set()
    told = {
        **refused,
        "reached": sorted(reached),
        "met": sorted(met - {name}),
        "heard": sorted(heard - own_messages),
    }
    print(json.dumps(told), flush=True)
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
