"""Tries to publish and to hear every topic of a graph's loop, and says how far it came.

python insider.py NAME SECONDS [NAMESPACE]

Whether with a key, and with whose, its environment says. Prints "there", and when the time is over
what it could create, whom it was matched with, and what it heard: one JSON object.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections import Counter

from ldt_ros.environment import prepare

TOPICS = ("experiment", "prediction", "signal", "adaptation", "model")


def main(name: str, seconds: float, namespace: str = "") -> None:
    """Try, and tell."""
    prepare()
    import rclpy

    from ldt_ros.interfaces import message_type, qos

    rclpy.init()
    node = rclpy.create_node(name, namespace=namespace)
    refused: dict[str, list[str]] = {"publishes": [], "hears": []}
    heard: Counter[str] = Counter()
    publishers, subscriptions = {}, {}
    for topic in TOPICS:
        kind, profile = message_type(topic), qos(topic)
        try:
            publishers[topic] = node.create_publisher(kind, topic, profile)
        except Exception:
            refused["publishes"].append(topic)
        try:
            subscriptions[topic] = node.create_subscription(
                kind, topic, lambda _, topic=topic: heard.update([topic]), profile
            )
        except Exception:
            refused["hears"].append(topic)
    print("there", flush=True)
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
        "heard": sorted(set(heard) - own_messages),
    }
    print(json.dumps(told), flush=True)
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), *sys.argv[3:])
