"""The samples of one channel, out of whatever topic a machine publishes them on."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from ldt_core.base.errors import OptionError, RecordingError
from ldt_core.recording.message_fields import number_in, parse_field_path, seconds
from ldt_core.recording.units import parse_field
from ldt_ros.nodes.interfaces import message_class

#: Samples that may wait: ten seconds of a fast machine on a busy computer.
DEPTH = 10_000
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


def stamp_of(message: Any) -> float | None:
    """Seconds in its header; None where there is none, or nobody has set it."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return None if stamp is None or (stamp.sec, stamp.nanosec) == (0, 0) else seconds(stamp)


def subscribe(node: Node, topic: str, callback: Callable[[str, Any], None]) -> str | None:
    """Listen to a topic of whatever type it has; the type, or None where nobody publishes yet.

    The profile is the publisher's: a voltage that is sent once and latched arrives as well.

    Raises:
        RecordingError: a type whose package is not installed.
    """
    offers = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    if not offers:
        return None
    kind = offers[0].topic_type
    try:
        known = message_class(kind) if MESSAGE_TYPE.fullmatch(kind) else None
    except (ImportError, AttributeError):
        known = None
    if known is None:
        raise RecordingError(topic, "a message type that is installed", kind)
    offered = [info.qos_profile for info in offers]
    reliable = all(q.reliability == ReliabilityPolicy.RELIABLE for q in offered)
    latched = all(q.durability == DurabilityPolicy.TRANSIENT_LOCAL for q in offered)
    profile = QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        history=HistoryPolicy.KEEP_LAST,
        depth=DEPTH,
    )
    node.create_subscription(known, topic, lambda m: callback(kind, m), profile)
    return kind
