"""A machine's streams of samples in, `experiment` out."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from ldt_core.base.errors import LdtError, OptionError, RecordingError
from ldt_core.base.experiment import Experiment
from ldt_core.base.sentences import few
from ldt_core.base.settings import ENDLESS
from ldt_core.base.units import parse_field
from ldt_core.recording.message_fields import number_in, parse_field_path
from ldt_core.recording.node_status import LEFT_OUT, WRONG_STREAM, NodeStatus
from ldt_core.restart.recorded_run import END
from ldt_core.segmenter import CHANNELS, Segmenter, build_rule
from ldt_core.segmenter.cut_rules import SteadyRule
from ldt_core.segmenter.resampling import LOST_STEPS
from ldt_core.segmenter.segmenter import ArrivalClock
from ldt_ros.nodes.interfaces import message_class, stamp_of, to_message
from ldt_ros.nodes.node import LINGER, LdtNode
from ldt_ros.nodes.statements import StartGate

#: Value of a parameter in whose place that of the machine file, or the usual one, is taken.
UNSET = -1.0
#: Time between two looks for topics, and for silence [s].
LOOK_PERIOD = 0.1
#: Looks without a sample, 1 s, after which no voltage is awaited that may still come.
SILENT_LOOKS = 10
#: Looks, 5 s, after which a topic that nobody publishes is told: DDS finds publishers within one.
MISSING_LOOKS = 50
#: Topics that are named beside it, at most.
MOST_NAMED = 6
#: Samples that may wait: ten seconds of a fast machine on a busy computer.
DEPTH = 10_000
NEEDED = ("voltage", "speed")
MESSAGE_TYPE = re.compile(r"\w+/msg/\w+")
NUMBER = re.compile(r"std_msgs/msg/(Float|U?Int)\d+")
#: Message type → channel → where its number is, if the option names no field.
FIELDS: dict[str, dict[str, tuple[str | int, ...]]] = {
    "sensor_msgs/msg/JointState": {
        "voltage": ("effort", 0),
        "speed": ("velocity", 0),
        "current": ("effort", 0),
    },
    "sensor_msgs/msg/BatteryState": {"voltage": ("voltage",), "current": ("current",)},
}


@dataclass
class Feed:
    """Where a channel's samples come from.

    Args:
        channel: voltage, speed or current.
        text: TOPIC or TOPIC.FIELD[INDEX], with :UNIT.

    Raises:
        OptionError: something else, or an unknown unit.
    """

    channel: str
    text: str
    topic: str = field(init=False)
    steps: tuple[str | int, ...] = field(init=False, default=())
    factor: float = field(init=False)

    def __post_init__(self) -> None:
        option = f"{self.channel}_from"
        try:
            parsed = parse_field(self.text, self.channel)
        except OptionError as error:
            raise OptionError(option, error.expected, error.got) from None
        self.factor = parsed.factor
        absolute = parsed.name.startswith("/")
        text = parsed.name if absolute else f"/{parsed.name}"
        if "." in text:
            source = parse_field_path(option, text)
            self.topic, self.steps = source.topic, source.steps
        elif re.search(r"[\[\]\s]|^/*$", text):
            raise OptionError(option, "TOPIC or TOPIC.FIELD[INDEX]", repr(self.text))
        else:
            self.topic = text
        self.topic = self.topic if absolute else self.topic.removeprefix("/")

    def value(self, kind: str, message: Any) -> float:
        """The number in a message of this type, in SI units.

        Raises:
            RecordingError: it has none there.
        """
        steps = self.steps or FIELDS.get(kind, {}).get(self.channel)
        if not steps and NUMBER.fullmatch(kind):
            steps = ("data",)
        if not steps:
            expected = f"a field in the option, {self.topic}.FIELD, for a message of type {kind}"
            raise RecordingError(self.topic, expected, "none")
        if not self.steps and len(getattr(message, "name", ())) > 1:
            expected = f"one joint, or a field with an index, {self.topic}.{steps[0]}[0]"
            raise RecordingError(self.topic, expected, f"{len(message.name)} joints")
        return number_in(self.topic, message, steps) * self.factor


class Source(NamedTuple):
    """What a topic's publishers offer together.

    Args:
        kind: message type.
        reliable, latched: whether all of them are.
        publishers: how many they are.
    """

    kind: str
    reliable: bool
    latched: bool
    publishers: int

    @classmethod
    def of(cls, node: Node, topic: str) -> Source | None:
        """None where nobody publishes."""
        offers = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
        if not offers:
            return None
        offered = [info.qos_profile for info in offers]
        reliable = all(q.reliability == ReliabilityPolicy.RELIABLE for q in offered)
        latched = all(q.durability == DurabilityPolicy.TRANSIENT_LOCAL for q in offered)
        return cls(offers[0].topic_type, reliable, latched, len(offers))

    def serves(self, asked: Source) -> bool:
        """Whether a subscription for another one hears this."""
        return (
            self.kind == asked.kind
            and self.reliable >= asked.reliable
            and self.latched >= asked.latched
        )

    def subscribe(
        self, node: Node, topic: str, callback: Callable[[str, Any], None]
    ) -> Subscription:
        """Listen: a voltage that is sent once and latched arrives as well.

        Raises:
            RecordingError: a type whose package is not installed.
        """
        try:
            known = message_class(self.kind) if MESSAGE_TYPE.fullmatch(self.kind) else None
        except (ImportError, AttributeError):
            known = None
        if known is None:
            raise RecordingError(topic, "a message type that is installed", self.kind)
        reliability, durability = ReliabilityPolicy, DurabilityPolicy
        profile = QoSProfile(
            reliability=reliability.RELIABLE if self.reliable else reliability.BEST_EFFORT,
            durability=durability.TRANSIENT_LOCAL if self.latched else durability.VOLATILE,
            history=HistoryPolicy.KEEP_LAST,
            depth=DEPTH,
        )
        return node.create_subscription(known, topic, lambda m: callback(self.kind, m), profile)


class SegmenterNode(LdtNode):
    """Cuts what a machine streams into experiments (see `Segmenter` for how).

    | received | what happens |
    |---|---|
    | samples before all nodes of the graph are ready | ignored |
    | a sample with a stamp | taken at its stamp |
    | a sample without | taken when it came, on the clock of those with stamps |
    | a field that is not there, or is no finite number | counted, logged once per kind |
    | two publishers of one topic | as after a pause, until there is one; counted |
    | nothing for 1 s | what waits for a voltage is taken with the voltage there is |
    | no speed for 5 s, or for the longest pause | told of until one comes |

    Started again in the middle of a run, it numbers on; what the machine streamed meanwhile is
    lost.
    """

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("segmenter", "machine", "segmenter", "cut", "run", **node_arguments)
        self._gate = StartGate(self, self._hear)
        settings = {n: v for n, v in self.settings.items() if v != UNSET}
        period = settings.get("sample_period", self.machine.sample_period)
        names = ("trigger_level", "pre_trigger", "steady_band", "steady_time")
        rule = build_rule(
            settings["cut"],
            period,
            settings.get("length", self.machine.duration),
            **{name: self.settings[name] for name in names},
        )
        feeds = [Feed(c, text) for c in CHANNELS if (text := settings[f"{c}_from"]) or c in NEEDED]
        # The speed last: what drives the joint is known then if one message has both.
        self._feeds = sorted(feeds, key=lambda feed: feed.channel == "speed")
        self.segmenter = Segmenter(
            rule,
            period,
            gap=settings.get("longest_gap"),
            lateness=settings["lateness"],
            current=any(feed.channel == "current" for feed in feeds),
        )
        self._arrivals = ArrivalClock()
        #: Whether stamped messages have come, and others, each with the topic of the first one.
        self._timed: dict[bool, str] = {}
        self._early: dict[str, tuple[float, float]] = {}
        #: Topic → its source, once somebody publishes it, and who listens to that.
        self._sources: dict[str, tuple[Source, Subscription | None]] = {}
        self._doubled = self.topics.rivals.further
        self._publisher = self.topics.publishes("experiment")
        self._begun = self._speed_came = False
        #: Experiments of before this node was started again.
        self._before, _ = self.recording.last_of("experiment", END)
        self._sent = self._last = self._before
        self._sent_at = 0.0
        given = "experiments" in getattr(self, "_parameter_overrides", {})
        #: A machine that streams has no last experiment, unless somebody says so.
        self._most = self.settings["experiments"] if given else ENDLESS
        self._silent = self._speedless = self._looks = 0
        self.create_timer(LOOK_PERIOD, self._look, clock=self.steady)
        self._look()

    def health(self) -> dict[str, Any]:
        """Number of the last experiment, where its samples come from, and what was left out."""
        values: dict[str, Any] = {"experiment": self._last, "sent": self._sent}
        for feed in self._feeds:
            source, _ = self._sources.get(feed.topic, (None, None))
            kind = source.kind if source else "nobody publishes it"
            values[f"{feed.channel} from"] = f"{self.resolve_topic_name(feed.topic)} ({kind})"
        values["samples"] = self.segmenter.rows_in
        if isinstance(self.segmenter.rule, SteadyRule):
            values["range of the speed"] = f"{self.segmenter.rule.statistic:.6g} rad/s"
        if words := self._wrong():
            values[WRONG_STREAM] = words
        return values | {f"{LEFT_OUT}{why}": n for why, n in self.segmenter.counts.items()}

    @property
    def patience(self) -> float:
        """Longest time that a process waits for `quiet` when it is told to stop [s]."""
        return 2 * LINGER

    @property
    def quiet(self) -> bool:
        """Whether all have had time to take the last experiment."""
        return time.monotonic() - self._sent_at > LINGER

    def halt(self) -> None:
        """Cut no further experiment, and say which was the last."""
        self.stopped = not self.finished
        self.report.tell()

    def _hear(self, told: NodeStatus) -> None:
        """Number on from what the twin has had, of which not all may be recorded."""
        if told.role == "twin" and self.settings["resume"] and self._sent == self._before:
            had = (told.number("experiment") or 0) + (told.number("waiting") or 0)
            self._sent = self._last = self._before = max(self._before, had)

    def _look(self) -> None:
        """Find topics that have come up, notice two publishers, notice silence."""
        for topic in dict.fromkeys(feed.topic for feed in self._feeds):
            source = Source.of(self, topic)
            if source is not None:
                self._subscribe(topic, source)
            if source is not None and source.publishers > 1:
                if topic not in self._doubled:
                    self._doubled.add(topic)
                    self._publish(self.segmenter.interrupt(f"more than one publisher of {topic}"))
            else:
                self._doubled.discard(topic)
        # Looks are counted, not seconds: this process may have slept, with samples in its queue.
        self._silent, self._speedless = self._silent + 1, self._speedless + 1
        self._looks += 1
        for words in self._missing() if self._looks == MISSING_LOOKS else ():
            self.get_logger().warning(words)
        if self._silent == SILENT_LOOKS:
            self._publish(self.segmenter.catch_up())

    def _missing(self) -> list[str]:
        """Which topics nobody publishes, and which there are that could be meant."""
        feeds = [feed for feed in self._feeds if feed.topic not in self._sources]
        if not feeds:
            return []
        numbers = [
            f"{name} ({kinds[0]})"
            for name, kinds in self.get_topic_names_and_types()
            if NUMBER.fullmatch(kinds[0]) or kinds[0] in FIELDS
        ]
        there = f"there are {few(numbers, MOST_NAMED)}" if numbers else "there is none"
        return [
            f"{feed.channel}_from: nobody publishes {self.resolve_topic_name(feed.topic)} yet; "
            f"of topics of numbers {there}"
            for feed in feeds
        ]

    def complaint(self) -> str:
        """What is wrong with the stream."""
        return "; ".join(filter(None, [super().complaint(), self._wrong()]))

    def _wrong(self) -> str:
        """Topics that nobody publishes, times that cannot be trusted, and another rate."""
        found = [self._untimed(), self._silence()]
        if self._looks > MISSING_LOOKS:
            found += self._missing()
            if self._timed.keys() == {True}:
                bare = self.resolve_topic_name(self._timed[True])
                found.append(
                    f"messages on {bare} have no stamp and count when they come: what delays them "
                    "looks like another machine; stamp them"
                )
        pace, period = self.segmenter.pace, self.segmenter.period
        if pace is not None and not 1 / LOST_STEPS < pace / period < LOST_STEPS:
            found.append(
                f"a speed comes every {pace:.3g} s, while the sample period is {period:g} s: "
                f"give --sample-period {pace:.3g}"
            )
        return "; ".join(filter(None, found))

    def _silence(self) -> str:
        """That a speed came, or could come, and does not; a voltage may be sent once."""
        topic, waited = self._feeds[-1].topic, self._speedless * LOOK_PERIOD
        longest = max(MISSING_LOOKS * LOOK_PERIOD, self.segmenter.gap)
        if self.ended or topic not in self._sources or waited <= longest:
            return ""
        gone = "" if self.count_publishers(topic) else ", and nobody publishes it any more"
        return f"nothing has come on {self.resolve_topic_name(topic)} for {waited:.0f} s{gone}"

    def _subscribe(self, topic: str, source: Source) -> None:
        """Listen to a topic; anew where its publisher is another."""
        asked, heard = self._sources.get(topic, (None, None))
        if asked and source.serves(asked):
            return
        if heard is not None:
            self.destroy_subscription(heard)
        try:
            heard = source.subscribe(self, topic, lambda kind, m: self._on_sample(topic, kind, m))
            self.get_logger().info(f"listening to {self.resolve_topic_name(topic)} ({source.kind})")
        except LdtError as error:
            self.topics.reject(topic, error)
            heard = None
        self._sources[topic] = source, heard

    def _on_sample(self, topic: str, kind: str, message: Any) -> None:
        if topic == self._feeds[-1].topic:
            self._speedless = 0
        now, stamp = time.time(), stamp_of(message)
        at = self._arrivals.unstamped(now) if stamp is None else self._arrivals.stamped(stamp, now)
        if (stamp is None) not in self._timed:
            self._tell_timing(topic, stamp is None)
        self._begun = self._begun or self._gate.is_open  # the graph is not asked at every sample
        if self.ended or self._doubled or not self._begun:
            return
        self._silent = 0
        self.topics.counts[topic] += 1
        for feed in self._feeds:
            if feed.topic != topic:
                continue
            try:
                value = feed.value(kind, message)
            except LdtError as error:
                self.topics.reject(topic, error)
                continue
            if stamp is None and feed.channel != "speed" and not self._speed_came:
                # Which clock is that of the stamps is known when the first speed has come.
                self._early[feed.channel] = (now, value)
                continue
            self._speed_came = self._speed_came or feed.channel == "speed"
            for channel, (came, early) in self._early.items():
                self._publish(self.segmenter.feed(channel, self._arrivals.unstamped(came), early))
            self._early.clear()
            self._publish(self.segmenter.feed(feed.channel, at, value))

    def _tell_timing(self, topic: str, bare: bool) -> None:
        self._timed[bare] = topic
        if words := self._untimed():
            self.get_logger().warning(words)

    def _untimed(self) -> str:
        if len(self._timed) < 2:
            return ""
        bare, stamped = (self.resolve_topic_name(self._timed[x]) for x in (True, False))
        return (
            f"messages on {bare} have no stamp and count when they come, those on {stamped} at "
            "their stamps: a delay between them looks like another machine; stamp them all"
        )

    def _publish(self, experiments: list[Experiment]) -> None:
        for experiment in experiments:
            if self.ended:
                return
            self._last = experiment.number + self._before
            self._publisher.publish(to_message(replace(experiment, number=self._last)))
            self._sent += 1
            self._sent_at = time.monotonic()
            if self._sent >= self._most:
                self.finished = True
                self.report.tell()
