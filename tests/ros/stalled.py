"""A process that subscribes to all topics, reliably and with their past, and says when it has.

python stalled.py
"""

from __future__ import annotations

import time

from ldt_ros.graph.environment import prepare

prepare()

import rclpy  # noqa: E402

import msgs_config  # noqa: E402
from ldt_ros.nodes.interfaces import message_type, qos  # noqa: E402

rclpy.init()
node = rclpy.create_node("stalled")
met: set[str] = set()
for topic in msgs_config.topics():
    node.create_subscription(message_type(topic), topic, lambda message: None, qos(topic))
print("there", flush=True)
while len(met) < 5:
    rclpy.spin_once(node, timeout_sec=0.1)
    met |= {t for t in msgs_config.topics() if node.count_publishers(t)}
print("met", flush=True)
while rclpy.ok():
    rclpy.spin_once(node, timeout_sec=0.1)
    time.sleep(0.001)
