"""What all nodes of the graph share: parameters, topics, health, and rejection of bad messages."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

import msgs_config
from ldt_core.base.errors import LdtError, RecordingError
from ldt_core.base.printable import one_line
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.node_status import (
    FINISHED,
    HEALTH_TOPIC,
    LAST_REJECTION,
    READY,
    REJECTED,
    STOPPED,
)
from ldt_core.restart.recorded_run import RecordedRun
from ldt_core.twin.stage import RecordedStep
from ldt_ros.nodes.interfaces import declare, listener_qos, message_type, qos
from ldt_ros.nodes.links import Links
from ldt_ros.nodes.rivals import Rivals
from ldt_ros.nodes.watchdog import alive

HEALTH_PERIOD = 1.0  # s, as the stock diagnostic aggregator expects
SOON_DUE = 0.5  # s after it was told last, when health goes along with that of another node
LINGER = 0.3  # s between telling of the end and ending, so that the telling arrives
CHECK_PERIOD = 0.05  # s; how soon a change of readiness is told, which the start of a run waits for
#: Who listen to the health of one graph alone. Where more do, there are more graphs, all of whose
#: nodes ask the middleware, which looks through what it knows of all of them: they ask less often.
LISTENERS = 3
REFUSED = "refused experiment"  # key of the twin's health: there will be no prediction of it
SOON = 60.0  # s after its start, in which a node asks the recording for what nobody sends
TRIES = 6  # to read a recording whose recorder was started again as well, with
MENDING = 0.5  # s in between
VAIN = 3  # times that it asks for what is not there: the numbers have gaps
SHOWN = 400  # characters of a rejection's reason; a foreign message may be of any size


class TwinNode(Node):
    """A node of the twin.

    A message that cannot be used is counted and logged once per kind, and the node goes on. Health
    goes to `/diagnostics`: once a second, and at once when readiness changes or a listener joins.

    Args:
        role: name of the node (`plant`, `twin`, …).
        groups: parameter groups that it declares.
    """

    def __init__(self, role: str, *groups: str, **node_arguments: Any) -> None:
        super().__init__(role, **node_arguments)
        self.role = role
        self.settings = declare(self, *groups, "node", "resume", "place")
        self.machine = load_machine(self.settings["machine"])
        self.full_name = f"{self.get_namespace().strip('/')}/{role}".lstrip("/")
        #: Set when the node has no more work, for nodes that end by themselves.
        self.finished = False
        #: Set when such a node was told to stop before it had finished.
        self.stopped = False
        #: Why the node cannot go on, for what does not happen within a callback.
        self.failure: Exception | None = None
        #: Time that passes whatever a simulated clock says.
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.counts: Counter[str] = Counter()
        self.rejected: Counter[str] = Counter()
        self._last_rejection = ""
        self._outputs: dict[str, Publisher] = {}
        self._inputs: dict[str, Subscription] = {}
        self.rivals = Rivals(self, self._outputs, self._inputs)
        self.links = Links(self)
        self._health = self.create_publisher(DiagnosticArray, HEALTH_TOPIC, qos(HEALTH_TOPIC))
        self._began = time.monotonic()
        self._in_vain = 0
        #: Other nodes of this process, whose health goes into the same message.
        self.colleagues: list[TwinNode] = []
        self._seen: tuple = ()
        self._looked_at = 0.0
        self._told: tuple = ()
        self._met = False
        self._told_at = 0.0
        self._told_to = 0
        self.create_timer(CHECK_PERIOD, self._tell, clock=self.steady)

    def publishes(self, topic: str) -> Publisher:
        """A publisher of a declared topic."""
        self._outputs[topic] = self.create_publisher(
            message_type(topic), topic, qos(topic), event_callbacks=self.links.of_output(topic)
        )
        return self._outputs[topic]

    def listens(
        self, topic: str, callback: Callable[[Any], None], *, raw: bool = False, depth: int = 0
    ) -> None:
        """Subscribe to a declared topic; what the callback refuses is counted, not raised.

        A second time it is in place of the first.
        """
        if topic in self._inputs:
            self.destroy_subscription(self._inputs.pop(topic))

        def guarded(message: Any) -> None:
            try:
                self.counts[topic] += 1
                self.links.heard(topic)
                callback(message)
            except LdtError as error:
                self.reject(topic, error)

        self._inputs[topic] = self.create_subscription(
            message_type(topic),
            topic,
            guarded,
            self._listener_qos(topic, depth),
            raw=raw,
            event_callbacks=self.links.of_input(topic),
        )
        self.links.add(topic, self._inputs[topic])

    def _listener_qos(self, topic: str, depth: int) -> QoSProfile:
        """What was missed, and signs of life, are asked for alone of nodes of this graph.

        They keep the one and give the other; a machine of the user's may not. Who was started
        again, or cut off from another host for a while, has missed something. From one
        subscription: of two, one would hear the present before the other hears the past.
        """
        ours = set(self.settings["graph"]) & set(msgs_config.topics()[topic]["publisher"])
        return listener_qos(topic, depth, own=bool(ours))

    def recorded(self, around: int = 0) -> Iterator[RecordedStep]:
        """Steps of the recording that the node goes on from, none where it begins anew.

        Args:
            around: as of `RecordedRun.steps`: where to begin in it.

        Raises:
            RecordingError: a recording that cannot be read.
        """
        last, run = 0, RecordedRun(self.settings["resume"], self.get_namespace(), self.machine)
        for again in reversed(range(TRIES if self.settings["resume"] else 0)):
            try:
                for step in run.steps(last or around):
                    if step.experiment.number > last:
                        last = step.experiment.number
                        alive()  # a long recording takes longer than a watchdog waits
                        yield step
                return
            except (RecordingError, OSError):  # its recorder may be mending it at this moment
                if not again:
                    raise
                time.sleep(MENDING)

    def missed(self, last: int, number: int) -> Iterator[RecordedStep]:
        """Recorded steps between two, where this node was started again a moment ago.

        What it reads at its start may be older than what another one reads, that is started again
        after it: that one goes on from there, and nobody sends what is between.
        """
        soon = time.monotonic() - self._began < SOON and self._in_vain < VAIN
        if not (self.settings["resume"] and soon and number > last + 1):
            return
        found = False
        for step in self.recorded(last):
            if step.experiment.number >= number:
                break
            if step.experiment.number > last:
                found = True
                yield step
        self._in_vain += not found

    def last_recorded(self, topic: str, around: int = 0) -> int:
        """The last experiment that a recorded record of a topic is about, 0 if there is none."""
        if not self.settings["resume"]:
            return 0
        run = RecordedRun(self.settings["resume"], self.get_namespace(), self.machine)
        return run.last_of(topic, around)

    def reject(self, topic: str, error: Exception) -> None:
        """Count a message that cannot be used; log the first of its kind."""
        kind = f"{topic}: {type(error).__name__}"
        self.rejected[kind] += 1
        reason = one_line(str(error))
        reason = reason if len(reason) <= SHOWN else reason[: SHOWN - 3] + "..."
        self._last_rejection = f"{topic}: {reason}"
        if self.rejected[kind] == 1:
            self.get_logger().error(f"rejected a message on {self._last_rejection}")

    def health(self) -> dict[str, Any]:
        """Further values for `/diagnostics`, by name."""
        return {}

    def complaint(self) -> str:
        """What a person should look at, in a sentence; "" when all is well; a node's own."""
        return ""

    def halt(self) -> None:
        """Begin no new work: the process has been told to stop."""

    def close(self) -> None:
        """Finish work before the node is destroyed."""

    @property
    def done(self) -> bool:
        """Whether the node has finished, and others have had time to hear it."""
        told = bool(self._told) and self._told[2]
        return told and time.monotonic() - self._told_at > LINGER

    @property
    def ended(self) -> bool:
        """Whether it begins nothing more: it has finished, or was stopped before."""
        return self.finished or self.stopped

    @property
    def ready(self) -> bool:
        """Whether every topic has met the peers that the graph has for it."""
        peers = set(self.settings["graph"])
        table = msgs_config.topics()
        ends = [
            (_matched(end), peers & set(table[topic][other]), ask, topic)
            for own, other, ask in (
                (self._outputs, "subscriber", self.get_subscriptions_info_by_topic),
                (self._inputs, "publisher", self.get_publishers_info_by_topic),
            )
            for topic, end in own.items()
        ]
        # Numbers first: to ask for names means to go through the whole graph.
        if any(matched < len(wanted) for matched, wanted, _, _ in ends):
            return False
        for matched, wanted, ask, topic in ends:
            found = [info.node_name for info in ask(topic)]
            # Being seen in the graph comes before being matched; only the latter gets messages.
            if matched < len(found) or not wanted <= set(found):
                return False
        return True

    def _tell(self) -> None:
        now = time.monotonic()
        listeners = self._health.get_subscription_count()
        patience = CHECK_PERIOD * max(1.0, listeners / LISTENERS)
        situation = (*self._looked(now, patience), self.finished)
        new = listeners != self._told_to and now - self._told_at >= min(patience, HEALTH_PERIOD)
        if situation == self._told and not new and now - self._told_at < HEALTH_PERIOD:
            return
        rivals = situation[1]
        if rivals and (not self._told or self._told[1] != rivals):
            if self.rivals.alarms:
                self.get_logger().error(rivals)
            else:
                self.get_logger().warning(rivals)
        self._told = situation
        self._met = self._met or situation[0]
        self.tell()

    def _looked(self, now: float, patience: float) -> tuple[bool, str]:
        """Whether all have met, and what is to be said of rivals, as of a moment ago.

        The graph is asked at once when somebody was met or lost, else after some patience; and once
        all have met, as rarely as health is told.
        """
        seen = tuple(map(_matched, (*self._outputs.values(), *self._inputs.values())))
        ready, rivals = self._told[:2] if self._told else (False, "")
        if seen == self._seen and now - self._looked_at < (HEALTH_PERIOD if ready else patience):
            return ready, rivals
        self._seen, self._looked_at = seen, now
        self.rivals.look()
        return self.ready, self.rivals.words()

    def tell(self) -> None:
        """Publish health now: others wait for what it says.

        With it goes that of the process's other nodes whose turn is soon: in a fleet, everybody
        hears everybody, and a message costs more than what it says.
        """
        now = time.monotonic()
        soon = (n for n in self.colleagues if not n.finished and now - n._told_at > SOON_DUE)
        message = DiagnosticArray(status=[node.status(now) for node in (self, *soon)])
        message.header.stamp = self.get_clock().now().to_msg()
        self._health.publish(message)
        alive()

    def status(self, now: float) -> DiagnosticStatus:
        """Health as it is to be told now."""
        self._told_at, self._told_to = now, self._health.get_subscription_count()
        ready = self._told[0] if self._told else False
        status = DiagnosticStatus(name=self.full_name, hardware_id=self.machine.name)
        status.level, status.message = self._verdict()
        values = {READY: _word(ready), FINISHED: _word(self.finished)}
        if self.stopped:
            values[STOPPED] = _word(True)
        values |= self.health()
        values |= self.rivals.health()
        values |= self.links.health()
        values |= {f"received {t}": n for t, n in self.counts.items()}
        # A copy: what works on a thread of its own may reject as well.
        values |= {f"{REJECTED}{kind}": n for kind, n in dict(self.rejected).items()}
        if self._last_rejection:
            values[LAST_REJECTION] = self._last_rejection
        status.values = [KeyValue(key=k, value=str(v)) for k, v in values.items()]
        return status

    def _verdict(self) -> tuple[bytes, str]:
        found = [self.rivals.words(), self.links.words(), self.complaint()]
        if self.rejected:
            found.append(f"{sum(self.rejected.values())} messages rejected")
        words = "; ".join(filter(None, found))
        if words:
            alarm = bool(self.rivals.alarms)
            return DiagnosticStatus.ERROR if alarm else DiagnosticStatus.WARN, words
        if self._told and self._told[0]:
            return DiagnosticStatus.OK, "running"
        return DiagnosticStatus.OK, "its peers have left" if self._met else "waiting for its peers"


def _matched(end: Publisher | Subscription) -> int:
    """How many there are at the other end; cheap enough to be asked all the time."""
    if isinstance(end, Publisher):
        return end.get_subscription_count()
    return end.get_publisher_count()


def _word(value: bool) -> str:
    return str(value).lower()
