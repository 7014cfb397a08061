"""Records ↔ real ROS messages, through the one codec of the core."""

from __future__ import annotations

import array
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension, MultiArrayLayout, String

from ldt_core.recording.codec import Record, decode, encode
from ldt_core.recording.messages import Messages


def _doubles(values: Any) -> array.array[float]:
    # rclpy takes an array of doubles as it is; any other sequence it checks item by item.
    return array.array("d", values.tobytes())


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
    doubles=_doubles,
)


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
