"""Where experiments come from: the simulated machine, or a recording, at a pace."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState

from ldt_core.base.errors import LdtError, OptionError, reason_of
from ldt_core.base.experiment import Experiment
from ldt_core.machine import Plant
from ldt_core.recording.bag import read_bag
from ldt_core.recording.node_status import REFUSED, RESUMED_AT, NodeStatus
from ldt_core.recording.pace import parse_rate
from ldt_core.restart.recorded_run import END
from ldt_ros.nodes.interfaces import from_message, stamp_of, to_message
from ldt_ros.nodes.node import LINGER, LdtNode, NodePart
from ldt_ros.nodes.statements import StartGate

#: Parameters that it needs of its node.
GROUPS = ("pace", "twin", "stream")
#: Longest time that a stop waits for the experiment under way [s].
PATIENCE = 3.0
#: Time in which nodes that are there have found each other [s]: discovery takes at most 0.25 s.
MEETING = 1.0
#: Time after which it says for whom of its graph it waits [s]: nodes take seconds to start.
STARTING = 5.0
#: Experiments back to which one that is sent again is known, as of a recording merged with itself.
MOST_KEYS = 1000
#: Shortest and longest time between two looks at the clock [s].
SHORTEST_TICK, LONGEST_TICK = 0.005, 0.05
#: Looks at the clock during an experiment, if they are not nearer or farther than that.
TICKS_PER_EXPERIMENT = 50
#: Samples in 5 ms at most, 2000 a second: a listener in Python keeps up with that.
BURST = 10


class SampleStream:
    """Publishes the samples of one experiment after the other, as far as they are due."""

    def __init__(self, publish: Callable[[str], Publisher], joint: str) -> None:
        self.joint = joint
        self._speed = publish("joint_states")
        self._drive = {"voltage": publish("voltage"), "current": publish("current")}
        self._experiment: Experiment | None = None
        self._next = 0

    def load(self, experiment: Experiment | None) -> None:
        """The experiment that is streamed from now on."""
        self._experiment, self._next = experiment, 0

    @property
    def done(self) -> bool:
        """Whether all its samples are out."""
        return self._experiment is None or self._next >= len(self._experiment)

    def advance(self, now: float | None = None) -> None:
        """Publish what is due.

        Args:
            now: time of the machine [s since the epoch]; None for a burst, whatever the time.
        """
        one = self._experiment
        if one is None:
            return
        end = min(len(one), self._next + BURST)
        while self._next < end:
            at = one.start + self._next * one.period
            if now is not None and at > now:
                return
            self._send(one, self._next, at)
            self._next += 1

    def _send(self, one: Experiment, index: int, at: float) -> None:
        # The voltage first: a listener knows what drives the joint when its speed comes.
        for name, values in (("voltage", one.voltage), ("current", one.current)):
            if values is not None:
                message = JointState(name=[self.joint], effort=[float(values[index])])
                message.header.stamp = exact_stamp(at)
                self._drive[name].publish(message)
        message = JointState(name=[self.joint], velocity=[float(one.speed[index])])
        message.header.stamp = exact_stamp(at)
        self._speed.publish(message)


def exact_stamp(time: float) -> Time:
    """A time in seconds as a stamp, to half a nanosecond: the number comes back from it."""
    whole = math.floor(time)
    nanoseconds = round((time - whole) * 1e9)
    return Time(sec=whole + nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


class ExperimentSource(NodePart):
    """Publishes `experiment`, once all nodes of the graph have found each other.

    As fast as it goes, experiment i + 1 follows the `adaptation` of experiment i, so that no queue
    can overflow; if none comes within `adaptation_timeout`, it follows all the same and says so,
    and at once if the twin says that it refused experiment i. At a rate, an experiment is published
    when a machine would have finished it, whatever the twin does.

    Started again in the middle of a run, it goes on after the last experiment of which everything
    is recorded; what of the rest was heard already, the others leave out.

    With `stream` its samples are published too, before it, each at its time if there is a rate.
    With `stream: only` there are no experiments, and nobody is waited for: that is a machine to
    which the segmenter listens.

    | received | what happens |
    |---|---|
    | `adaptation` of the experiment sent last | the next is sent |
    | `adaptation` of another experiment | ignored; of a later one not where it was started again |
    | `/diagnostics` of the twin: it refused the experiment sent last | the next is sent |
    | anything that is no adaptation | counted, logged once per kind |

    Args:
        node: that publishes.
        fetch: gives the next experiment; None when there are no more.

    Attributes:
        adapted: number of the last experiment that is known to be adapted to.
    """

    patience = PATIENCE

    def __init__(self, node: LdtNode, fetch: Callable[[], Experiment | None]) -> None:
        self._node, self.fetch = node, fetch
        self._gate = StartGate(node, self._hear)
        settings = node.settings
        self.rate = 1.0 if settings["real_time"] else parse_rate(settings["rate"])
        self._timeout: float = settings["adaptation_timeout"]
        stream = settings["stream"]
        self._samples = SampleStream(node.topics.publishes, node.machine.name) if stream else None
        self._publisher = None
        if stream != "only":
            self._publisher = node.topics.publishes("experiment")
            node.topics.listens("adaptation", self._on_adaptation)
        # Of a run that goes on, the last experiment that is recorded as adapted to.
        last = deque((step.experiment for step in node.recording.steps(END)), maxlen=1)
        self._resumed = last[0] if last else None
        self.adapted = last[0].number if last else 0
        self._awaited = (last[0].number, last[0].start) if last else None
        self._passed = False  # whether one has come
        self._next: Experiment | None = None
        self._message: Any = None
        self._sent: Experiment | None = None
        self._keys: deque[tuple[int, float]] = deque(maxlen=MOST_KEYS)
        self._count = self.adapted
        self._under_way = False
        self._asked = False  # for the next experiment, where there is no rate
        self._began: tuple[float, float] | None = None
        self._waiting_since = time.monotonic()
        self._unheard = False  # whether nobody was there when the last was sent
        self._told = False  # for whom it waits
        self._ticker = node.create_timer(LONGEST_TICK, self._tick, clock=node.steady)

    def health(self) -> dict[str, Any]:
        """Number of the last experiment sent, how many were, and after which a run goes on."""
        sent = self._sent.number if self._sent else 0
        told: dict[str, Any] = {"experiment": sent, "sent": self._count}
        if self._resumed is not None:
            told |= {"resumed": self._resumed.number, RESUMED_AT: repr(self._resumed.end)}
        return told

    def halt(self) -> None:
        """Send no further experiment, and say which was the last."""
        self._node.stopped = not self._node.finished
        self._node.report.tell()

    @property
    def quiet(self) -> bool:
        """Whether all have had time to take the last experiment, which leaves with its sender."""
        return not self._under_way and time.monotonic() - self._waiting_since > LINGER

    def _hear(self, told: NodeStatus) -> None:
        """Begin once all are there; go on where the twin refused the experiment sent last."""
        sent = self._sent
        if self._began is None and not self._node.ended:
            self._begin_if_all_are_there()
        if told.role == "twin" and sent and told.values.get(REFUSED) == str(sent.number):
            self._go_on()

    def _on_adaptation(self, message: DiagnosticArray) -> None:
        adaptation = from_message("adaptation", message)
        answers = self._sent is not None and adaptation.experiment == self._sent.number
        if answers or (self._node.settings["resume"] and self._comes_after(message)):
            self.adapted = max(self.adapted, adaptation.experiment)
        if answers:
            self._go_on()

    def _comes_after(self, message: DiagnosticArray) -> bool:
        """Whether it is of a time behind that to which the recording went, which none of an
        earlier beginning of the counter is."""
        stamp = stamp_of(message)
        return stamp is None or self._resumed is None or stamp > self._resumed.start

    def _is_answered(self) -> bool:
        """Whether what was sent last had been adapted to before, so that nobody adapts now."""
        return self._under_way and self._sent is not None and self._sent.number <= self.adapted

    def _go_on(self) -> None:
        """The twin is done with the experiment sent last."""
        self._under_way = False
        if self._node.ended:
            return
        if self._next is None:
            self._node.finished = True
        elif self.rate is None:
            self._asked = True
            self._send_when_streamed()

    def _tick(self) -> None:
        if self._node.ended:
            self._ticker.cancel()
        elif self._began is None:
            self._begin_if_all_are_there()
            if self._began is None and time.monotonic() - self._waiting_since > STARTING:
                self._tell(f"waits for {', '.join(self._gate.missing)}, as its graph names them")
        else:
            if self._samples is not None:
                self._samples.advance(self._machine_time)
            if self._is_answered():
                self._go_on()
            if self._asked:
                self._send_when_streamed()
            elif self._next is None or self.rate is None:
                waited = time.monotonic() - self._waiting_since
                if waited > self._timeout:
                    self._give_up_waiting()
                elif waited > MEETING and not self._told and not self._node.settings["graph"]:
                    self._tell_if_alone()
            elif time.monotonic() >= self._due(self._next):
                self._send_when_streamed()

    def _begin_if_all_are_there(self) -> None:
        if not self._gate.is_open:
            return
        self._fetch()
        if self._next is None:
            self._node.finished = True
        else:
            self._began = (time.monotonic(), self._next.start)
            self._asked = self.rate is None
            self._tick_for(self._next)
            self._send_when_streamed()

    def _tick_for(self, first: Experiment) -> None:
        """Look at the clock as often as this pace asks for; each look costs 0.1 ms."""
        period = LONGEST_TICK
        if self._samples is not None:
            period = SHORTEST_TICK
        elif self.rate is not None:
            look = first.duration / self.rate / TICKS_PER_EXPERIMENT
            period = min(max(look, SHORTEST_TICK), LONGEST_TICK)
        if period < LONGEST_TICK:
            self._ticker.cancel()
            self._ticker = self._node.create_timer(period, self._tick, clock=self._node.steady)

    def _send_when_streamed(self) -> None:
        if self.rate is not None and self._next and time.monotonic() < self._due(self._next):
            return
        if self._samples is None or self._samples.done:
            self._send()

    @property
    def _machine_time(self) -> float | None:
        """Time of the machine at its rate [s since the epoch]; None where there is no rate."""
        if self.rate is None or self._began is None:
            return None
        wall, start = self._began
        return start + (time.monotonic() - wall) * self.rate

    def _due(self, experiment: Experiment) -> float:
        assert self._began is not None
        assert self.rate is not None
        wall, start = self._began
        return wall + (experiment.end - start) / self.rate

    def _tell_if_alone(self) -> None:
        """What was sent before others were there, or while nobody adapts, is waited for in vain."""
        assert self._sent is not None
        if not self._node.count_publishers(self._node.resolve_topic_name("adaptation")):
            why = "nobody publishes adaptations"
        elif self._unheard:
            why = "it was sent before anybody listened"
        else:
            return
        self._tell(
            f"waits {self._timeout:g} s (adaptation_timeout) for the adaptation of experiment "
            f"{self._sent.number}, but {why}; name all nodes in the graph of each, so that they "
            "wait for each other"
        )

    def _tell(self, words: str) -> None:
        """Log it, the first time."""
        if not self._told:
            self._told = True
            self._node.get_logger().info(words)

    def _give_up_waiting(self) -> None:
        assert self._sent is not None
        self._node.get_logger().warning(
            f"no adaptation of experiment {self._sent.number} within {self._timeout:g} s, going on"
        )
        if self._next is None:
            self._node.finished = True
        else:
            self._send()

    def _send(self) -> None:
        if self._next is not None:
            key = self._next.number, self._next.start
            if self._sent and key[0] <= self._sent.number and key not in self._keys:
                self.adapted = 0  # a recording whose counter began anew; of one again none comes
            self._keys.append(key)
        self._sent = self._next
        self._count += 1
        self._waiting_since = time.monotonic()
        if self._publisher is not None:
            self._unheard = not self._publisher.get_subscription_count()
            self._publisher.publish(self._message)
            self._under_way, self._asked = True, False
        # While the twin works on this one, the next is made.
        self._fetch()
        if self._publisher is None and self._next is None:
            self._node.finished = True

    def _fetch(self) -> None:
        self._next = self._message = None
        try:
            self._next = self.fetch()
            while self._next is not None and self._is_past(self._next):
                self._next = self.fetch()
            if self._next is not None:
                self._message = to_message(self._next)
            if self._samples is not None:
                self._samples.load(self._next)
        except BaseException as error:  # no fault of the message that it follows
            one = error if isinstance(error, Exception) else LdtError(reason_of(error))
            self._node.failure = one

    def _is_past(self, one: Experiment) -> bool:
        """Whether it comes before the end of the recording that goes on, or is its last.

        Numbers do not tell: a counter may have begun anew.
        """
        last = self._awaited
        if last is None:
            return False
        key = one.number, one.start
        if key == last or (key[0] > last[0] and key[1] > last[1] and not self._passed):
            self._awaited = None
        self._passed = True
        return key == last or self._awaited is not None


class PlantNode(LdtNode):
    """Simulates one experiment after the other (see `ExperimentSource` for pacing)."""

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("plant", "machine", "plant", "run", *GROUPS, **node_arguments)
        self.source = ExperimentSource(self, self._next)
        self.parts = [self.source]
        self.plant = Plant.from_settings(self.machine, self.settings)
        self._number = self.source.adapted

    def _next(self) -> Experiment | None:
        if self._number >= self.settings["experiments"]:
            return None
        self._number += 1
        return self.plant.experiment(self._number)


class PlayerNode(LdtNode):
    """Plays a recording (see `ExperimentSource` for pacing)."""

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("player", "machine", "player", *GROUPS, **node_arguments)
        recording, namespace, only = (self.settings[n] for n in ("play", "play_namespace", "only"))
        if not recording:
            raise OptionError("play", "a recording", "none")
        played = read_bag(recording, namespace, only=only)
        if odd := played.other_machine(self.machine):
            self.get_logger().warning(odd)
        experiments = played.experiments(refused=lambda e: self.topics.reject("experiment", e))
        self.source = ExperimentSource(self, lambda: next(experiments, None))
        self.parts = [self.source]
