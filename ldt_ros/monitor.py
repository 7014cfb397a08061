"""The launching process's ear on one machine's graph: puts the steps together, notices the end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from ldt_core.experiment import ModelRecord, Step
from ldt_ros.convert import from_message
from ldt_ros.interfaces import message_type, qos

TOPICS = ("experiment", "prediction", "original_prediction", "signal", "adaptation")
CAPACITY = 200  # steps under way; what is older has lost a part


class Monitor(Node):
    """Collects the messages of each experiment into a `Step`.

    Args:
        namespace: of the machine.
        on_step: called with each complete step, in the order in which they get complete.
    """

    def __init__(self, namespace: str, on_step: Callable[[Step], None]) -> None:
        super().__init__("monitor", namespace=namespace)
        self.on_step = on_step
        #: Health of each node, by role: the values it told last.
        self.health: dict[str, dict[str, str]] = {}
        self.last_experiment = 0
        self.last_step = 0
        self._parts: dict[int, dict[str, Any]] = {}
        self._models: dict[int, ModelRecord] = {}
        for topic in (*TOPICS, "model"):
            self.create_subscription(
                message_type(topic),
                topic,
                lambda message, topic=topic: self._collect(topic, message),
                qos(topic),
            )
        self.create_subscription(
            DiagnosticArray, "/diagnostics", self._on_health, qos("/diagnostics")
        )

    @property
    def source_finished(self) -> bool:
        """Whether the plant or player has nothing more to send."""
        return any(v.get("finished") == "true" for v in self.health.values())

    @property
    def idle(self) -> bool:
        """Whether every experiment heard of has gone all the way."""
        return self.last_step >= self.last_experiment

    def _on_health(self, message: DiagnosticArray) -> None:
        prefix = self.get_namespace().strip("/")
        for status in message.status:
            namespace, _, role = status.name.rpartition("/")
            if namespace == prefix:
                self.health[role] = {v.key: v.value for v in status.values}

    def _collect(self, topic: str, message: Any) -> None:
        record = from_message(topic, message)
        if topic == "model":
            self._models[record.version] = record
            return
        number = record.experiment if topic in ("signal", "adaptation") else record.number
        if topic == "experiment":
            self.last_experiment = number
        parts = self._parts.setdefault(number, {})
        parts[topic] = record
        if len(parts) == len(TOPICS):
            del self._parts[number]
            model = self._models.get(parts["adaptation"].model_version)
            changed = model is not None and model.version != parts["prediction"].model_version
            self.last_step = number
            self.on_step(Step(*(parts[t] for t in TOPICS), model if changed else None))
        elif len(self._parts) > CAPACITY:
            del self._parts[next(iter(self._parts))]
