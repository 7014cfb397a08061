"""Where experiments come from: pacing and flow control shared by the plant and the player."""

from __future__ import annotations

import abc
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from ldt_core.errors import LdtError
from ldt_core.experiment import Experiment
from ldt_core.pace import parse_rate
from ldt_core.recording.node_status import HEALTH_TOPIC, node_statuses
from ldt_ros.convert import from_message, to_message
from ldt_ros.interfaces import qos
from ldt_ros.node import LINGER, REFUSED, TwinNode

PATIENCE = 3.0  # s that a stop waits for the experiment under way
TICK = 0.005  # s, resolution of paced publishing


class SourceNode(TwinNode):
    """Publishes `experiment`, once all nodes of the graph have found each other.

    As fast as it goes, experiment i + 1 follows the `adaptation` of experiment i, so that no queue
    can overflow; if none comes within `adaptation_timeout`, it follows all the same and says so,
    and at once if the twin says that it refused experiment i. At a rate, an experiment is published
    when a machine would have finished it, whatever the twin does.

    | received | what happens |
    |---|---|
    | `adaptation` of the experiment sent last | the next is sent |
    | `adaptation` of another experiment | ignored |
    | `/diagnostics` of the twin: it refused the experiment sent last | the next is sent |
    | anything that is no adaptation | counted, logged once per kind |
    """

    def __init__(self, role: str, *groups: str, **node_arguments: Any) -> None:
        super().__init__(role, *groups, "pace", "twin", **node_arguments)
        self.rate = 1.0 if self.settings["real_time"] else parse_rate(self.settings["rate"])
        self._publisher = self.publishes("experiment")
        self.listens("adaptation", self._on_adaptation)
        self._ready_peers: set[str] = set()
        self.create_subscription(DiagnosticArray, HEALTH_TOPIC, self._on_health, qos(HEALTH_TOPIC))
        self._next: Experiment | None = None
        self._message: Any = None
        self._sent: Experiment | None = None
        self._count = 0
        self._under_way = False
        self._began: tuple[float, float] | None = None
        self._waiting_since = 0.0
        self._ticker = self.create_timer(TICK, self._tick, clock=self.steady)

    @abc.abstractmethod
    def fetch(self) -> Experiment | None:
        """The next experiment; None when there are no more."""

    @property
    def started(self) -> bool:
        """Whether the first experiment may be sent."""
        others = {r for r in self.settings["graph"] if r != self.role}
        return self.ready and others <= self._ready_peers

    def health(self) -> dict[str, Any]:
        """Number of the last experiment sent, and how many were."""
        return {"experiment": self._sent.number if self._sent else 0, "sent": self._count}

    def halt(self) -> None:
        """Send no further experiment, and say which was the last."""
        self.finished = True
        self.tell()

    #: How long a process waits for `quiet` when it is told to stop [s].
    patience = PATIENCE

    @property
    def quiet(self) -> bool:
        """Whether all have had time to take the last experiment, which leaves with its sender."""
        return not self._under_way and time.monotonic() - self._waiting_since > LINGER

    def _on_health(self, message: DiagnosticArray) -> None:
        for told in node_statuses(message, self.get_namespace()):
            if told.values.get("ready") == "true":
                self._ready_peers.add(told.role)
            sent = self._sent
            if told.role == "twin" and sent and told.values.get(REFUSED) == str(sent.number):
                self._go_on()

    def _on_adaptation(self, message: DiagnosticArray) -> None:
        adaptation = from_message("adaptation", message)
        if self._sent is not None and adaptation.experiment == self._sent.number:
            self._go_on()

    def _go_on(self) -> None:
        """The twin is done with the experiment sent last."""
        self._under_way = False
        if self.finished:
            return
        if self._next is None:
            self.finished = True
        elif self.rate is None:
            self._send()

    def _tick(self) -> None:
        if self.finished:
            self._ticker.cancel()
        elif self._began is None:
            if self.started:
                self._fetch()
                if self._next is None:
                    self.finished = True
                else:
                    self._began = (time.monotonic(), self._next.start)
                    if self.rate is None:
                        self._send()
        elif self._next is None or self.rate is None:
            if time.monotonic() - self._waiting_since > self.settings["adaptation_timeout"]:
                self._give_up_waiting()
        elif time.monotonic() >= self._due(self._next):
            self._send()

    def _due(self, experiment: Experiment) -> float:
        assert self._began is not None
        wall, start = self._began
        return wall + (experiment.end - start) / self.rate

    def _give_up_waiting(self) -> None:
        assert self._sent is not None
        self.get_logger().warning(
            f"no adaptation of experiment {self._sent.number} within "
            f"{self.settings['adaptation_timeout']:g} s, going on"
        )
        if self._next is None:
            self.finished = True
        else:
            self._send()

    def _send(self) -> None:
        self._publisher.publish(self._message)
        self._sent = self._next
        self._count += 1
        self._under_way = True
        self._waiting_since = time.monotonic()
        # While the twin works on this one, the next is made.
        self._fetch()

    def _fetch(self) -> None:
        self._next = self._message = None
        try:
            self._next = self.fetch()
            if self._next is not None:
                self._message = to_message(self._next)
        except LdtError as error:  # no fault of the message that it follows
            self.failure = error
