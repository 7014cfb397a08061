"""Messages, QoS profiles and ROS parameters, as declared in `msgs_config` and made by the core."""

from __future__ import annotations

import array
import difflib
import importlib
from collections.abc import Iterable
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
)
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from std_msgs.msg import (
    Float64MultiArray,
    Header,
    MultiArrayDimension,
    MultiArrayLayout,
    String,
)

import msgs_config
from ldt_core.base.settings import check
from ldt_core.recording.codec import Record, decode, encode
from ldt_core.recording.message_fields import seconds
from ldt_core.recording.messages import Messages

MESSAGES = Messages(
    Float64MultiArray=Float64MultiArray,
    MultiArrayLayout=MultiArrayLayout,
    MultiArrayDimension=MultiArrayDimension,
    String=String,
    Header=Header,
    Time=Time,
    DiagnosticArray=DiagnosticArray,
    DiagnosticStatus=DiagnosticStatus,
    KeyValue=KeyValue,
    level=lambda level: bytes([level]),
    # rclpy takes an array of doubles as it is; any other sequence it checks item by item.
    doubles=lambda values: array.array("d", values.tobytes()),
)
#: Messages that wait for those who only listen: nobody waits for them, so they may lag behind.
LISTENER_DEPTH = 1000
#: Profile whose past every listener wants.
LATCHED = "latched"


def to_message(record: Record, time: float = 0.0, machine: str = "") -> Any:
    """The ROS message of a record.

    Args:
        record: what to send.
        time: time of the statement [s since the epoch], for those with a stamp.
        machine: name of the machine, for those with a `hardware_id`.
    """
    return encode(record, MESSAGES, machine, time)


def from_message(topic: str, message: Any) -> Any:
    """The record in a ROS message that came on a topic.

    Raises:
        BadInput: no such record; the sentence names the topic, what was expected and what came.
    """
    return decode(topic, message)


def stamp_of(message: Any) -> float | None:
    """Seconds in its header; None where there is none, or nobody has set it."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return None if stamp is None or (stamp.sec, stamp.nanosec) == (0, 0) else seconds(stamp)


def message_class(kind: str) -> Any:
    """Class of a type of messages, such as `std_msgs/msg/String`.

    Raises:
        ImportError: its package is not installed.
        AttributeError: the package has no such message.
    """
    package, _, name = kind.partition("/msg/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def message_type(topic: str) -> Any:
    """Message class of a declared topic."""
    return message_class(msgs_config.topics()[topic]["type"])


def qos(topic: str) -> QoSProfile:
    """QoS profile with which a declared topic is published."""
    profile = msgs_config.qos_profiles()[msgs_config.topics()[topic]["qos"]]
    return QoSProfile(
        reliability=ReliabilityPolicy[profile["reliability"].upper()],
        durability=DurabilityPolicy[profile["durability"].upper()],
        history=HistoryPolicy[profile["history"].upper()],
        depth=profile["depth"],
        liveliness=LivelinessPolicy.AUTOMATIC,
        liveliness_lease_duration=Duration(seconds=profile.get("lease", 0.0)),
    )


def listener_qos(topic: str, depth: int = 0, own: bool = False) -> QoSProfile:
    """QoS profile with which a declared topic is listened to.

    Args:
        topic: as declared.
        depth: of the queue; 0 takes the declared one.
        own: ask for what was published before, and for signs of life, as nodes of one graph give
            them; else any publisher will do.
    """
    wanted = qos(topic)
    wanted.depth = depth or wanted.depth
    if not own:
        wanted.liveliness_lease_duration = Duration()  # none is asked for
        if msgs_config.topics()[topic]["qos"] != LATCHED:
            wanted.durability = DurabilityPolicy.VOLATILE
    return wanted


def declare(node: Node, *groups: str) -> dict[str, Any]:
    """Declare the parameters of the groups on a node and return their checked values.

    They are read-only: a run's numbers follow from the parameters that its recording begins with.
    YAML, in which all of them arrive, takes `threshold:=2` for an integer and `rate:=10` for a
    number; both mean what the command line's options mean.

    Raises:
        OptionError: a value outside its declared type, range or choices.
    """
    # rclpy has no public way to ask for what was given, and its own refusal names no parameter.
    given = {n: p.value for n, p in getattr(node, "_parameter_overrides", {}).items()}
    values = {}
    for name, declaration in msgs_config.parameters(*groups).items():
        if name in given:
            check(name, _meant(given[name], declaration), declaration)
        value = node.declare_parameter(name, declaration["default"], _descriptor(declaration)).value
        values[name] = check(name, _meant(value, declaration), declaration)
    _warn_of_slips(node, given)
    return values


def _meant(value: Any, declaration: dict[str, Any]) -> Any:
    """A parameter's value in the type that its declaration has."""
    kind = declaration["type"]
    if value is None:  # an empty list has no type
        return declaration["default"]
    if kind == "string" and isinstance(value, int | float) and not isinstance(value, bool):
        return str(value)
    if kind == "string_array" and isinstance(value, str):
        return [value]
    if isinstance(value, str | bool | int | float):
        return value
    return list(value)


def _warn_of_slips(node: Node, given: Iterable[str]) -> None:
    """Say which names are nearly one of ours; others belong to other nodes of a shared file."""
    known = msgs_config.parameters()
    for name in given:
        close = difflib.get_close_matches(name, known, n=1)
        if close and name not in known and not node.has_parameter(name):  # rclpy has its own
            node.get_logger().warning(f"no parameter {name!r}, did you mean {close[0]!r}?")


def _descriptor(declaration: dict[str, Any]) -> ParameterDescriptor:
    unit = declaration.get("unit", "")
    descriptor = ParameterDescriptor(
        description=declaration["description"] + (f" [{unit}]" if unit else ""),
        type=getattr(ParameterType, f"PARAMETER_{declaration['type'].upper()}"),
        read_only=True,
        # ROS would refuse an integer where a double is declared, in words that name no parameter.
        dynamic_typing=True,
    )
    choices = [c for c in declaration.get("choices", ()) if c]
    if choices:
        descriptor.additional_constraints = "one of " + ", ".join(choices)
    if "range" in declaration:
        low, high = declaration["range"]
        if declaration["type"] == "integer":
            descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=0)]
        else:
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(low), to_value=float(high), step=0.0)
            ]
    return descriptor
