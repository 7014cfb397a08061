"""Nodes that pass on the graph's messages and do nothing else: the floor that middleware sets.

`python -m tests.benchmarks.bare_node ROLE`, until it is killed. The role `lone` is a node by itself
that begins to publish `experiment` at once; the others answer what somebody else publishes there.
"""

from __future__ import annotations

import sys

import numpy as np

SAMPLES = 2000
#: role → (what it waits for in each cycle, what it sends then)
ROLES = {
    "twin": (("experiment",), ("original_prediction", "prediction")),
    "detector": (("experiment", "prediction"), ("signal",)),
    "adaptor": (("experiment", "signal"), ("adaptation",)),
    "recorder": (("experiment", "prediction", "original_prediction", "signal", "adaptation"), ()),
}
EAGER = 0.005  # s between the messages of the lone node


def main(role: str) -> None:
    """Pass messages on."""
    from ldt_ros.graph.environment import prepare

    prepare()
    import rclpy
    from rclpy.experimental import EventsExecutor

    from ldt_core.base.experiment import Action, Adaptation, Experiment, Level, Prediction, Signal
    from ldt_ros.nodes.interfaces import message_type, qos, to_message

    row = np.linspace(0.0, 1.0, SAMPLES)
    prediction = to_message(Prediction(1, 0.0, 0.01, 0, row))
    messages = {
        "experiment": to_message(Experiment(1, 0.0, 0.01, row, row)),
        "prediction": prediction,
        "original_prediction": prediction,
        "signal": to_message(Signal(1, Level.NEGATIVE, "threshold", 0, 0.1), 0.0, "rotor"),
        "adaptation": to_message(Adaptation(1, Action.KEPT, 0, "no drift"), 0.0, "rotor"),
    }
    waits, sends = ROLES.get(role, ((), ("experiment",)))
    rclpy.init()
    node = rclpy.create_node(f"bare_{role}")
    publishers = {t: node.create_publisher(message_type(t), t, qos(t)) for t in sends}
    seen: set[str] = set()

    def receive(topic: str) -> None:
        seen.add(topic)
        if role != "recorder" and seen.issuperset(waits):
            seen.clear()
            send()

    def send() -> None:
        for topic, publisher in publishers.items():
            publisher.publish(messages[topic])

    subscriptions = [
        node.create_subscription(
            message_type(t), t, lambda _, t=t: receive(t), qos(t), raw=role == "recorder"
        )
        for t in waits
    ]
    if role == "lone":
        node.create_timer(EAGER, send)
    executor = EventsExecutor()
    executor.add_node(node)
    while subscriptions or role == "lone":
        executor.spin_once(timeout_sec=0.1)


if __name__ == "__main__":
    main(sys.argv[1])
