"""The launching process's ear on one machine's graph: puts the steps together, notices the end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from ldt_core.errors import LdtError
from ldt_core.experiment import ModelRecord, Step
from ldt_ros.convert import from_message
from ldt_ros.interfaces import LISTENER_DEPTH, message_type, qos
from ldt_ros.node import REFUSED

TOPICS = ("experiment", "prediction", "original_prediction", "signal", "adaptation")
SOURCES = ("plant", "player")
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
                qos(topic, LISTENER_DEPTH),
            )
        self.create_subscription(
            DiagnosticArray, "/diagnostics", self._on_health, qos("/diagnostics")
        )

    @property
    def source_finished(self) -> bool:
        """Whether the plant or player has nothing more to send."""
        return any(self.health.get(r, {}).get("finished") == "true" for r in SOURCES)

    @property
    def idle(self) -> bool:
        """Whether every experiment that was sent has gone all the way, or was refused."""
        started = any(role in self.health for role in SOURCES)
        return self.last_step >= self.last_experiment and (self.source_finished or not started)

    def _on_health(self, message: DiagnosticArray) -> None:
        prefix = self.get_namespace().strip("/")
        for status in message.status:
            namespace, _, role = status.name.rpartition("/")
            if namespace == prefix:
                told = self.health[role] = {v.key: v.value for v in status.values}
                if role in SOURCES:
                    self.last_experiment = max(self.last_experiment, int(told["experiment"]))
                if told.get(REFUSED) == str(self.last_experiment):
                    self.last_step = max(self.last_step, self.last_experiment)

    def _collect(self, topic: str, message: Any) -> None:
        try:
            record = from_message(topic, message)
        except LdtError:
            return  # the nodes count it
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
