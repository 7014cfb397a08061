"""Nodes that pass on the graph's messages and do nothing else: the floor that middleware sets.

`python -m tests.benchmarks.bare_node ROLE CYCLES`; the source prints the median cycle in seconds.
The role `lone` is a node by itself that begins to publish `experiment` at once.
"""

from __future__ import annotations

import statistics
import sys
import time

import numpy as np

SAMPLES = 2000
LOST = 1.0  # s after which a message never came
SKIPPED = 20  # cycles of warming up
TOPICS = ("experiment", "prediction", "original_prediction", "signal", "adaptation")
#: role → (what it waits for in each cycle, what it sends then)
ROLES = {
    "source": (("adaptation",), ("experiment",)),
    "twin": (("experiment",), ("original_prediction", "prediction")),
    "detector": (("experiment", "prediction"), ("signal",)),
    "adaptor": (("experiment", "signal"), ("adaptation",)),
    "recorder": (TOPICS, ()),
}
EAGER = 0.005  # s between the messages of the lone node


def main(role: str, cycles: int) -> None:
    """Pass messages on until the source has had its cycles, or a signal ends the process."""
    from ldt_ros.environment import prepare

    prepare()
    import rclpy
    from rclpy.experimental import EventsExecutor

    from ldt_core.experiment import Action, Adaptation, Experiment, Level, Prediction, Signal
    from ldt_ros.convert import to_message
    from ldt_ros.interfaces import message_type, qos

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
    times: list[float] = []

    def receive(topic: str) -> None:
        seen.add(topic)
        if role != "recorder" and seen.issuperset(waits):
            seen.clear()
            send()

    def send() -> None:
        times.append(time.perf_counter())
        for topic, publisher in publishers.items():
            publisher.publish(messages[topic])

    subscriptions = [
        node.create_subscription(
            message_type(t), t, lambda _, t=t: receive(t), qos(t), raw=role == "recorder"
        )
        for t in waits
    ]
    executor = EventsExecutor()
    executor.add_node(node)
    if role == "lone":
        node.create_timer(EAGER, send)
    listeners = {t: sum(t in w for w, _ in ROLES.values()) for t in TOPICS}
    if role == "source":
        while not all(node.count_publishers(t) == 1 for t in TOPICS) or not all(
            node.count_subscribers(t) == n for t, n in listeners.items()
        ):
            executor.spin_once(timeout_sec=0.05)
        time.sleep(1.0)
        send()
    while len(times) <= cycles:
        executor.spin_once(timeout_sec=0.1)
        # Discovered is not yet matched: the first message may be lost.
        if role == "source" and time.perf_counter() - times[-1] > LOST:
            times.clear()
            send()
    if role == "source":
        print(statistics.median(np.diff(times[SKIPPED:])), flush=True)
    del subscriptions


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
