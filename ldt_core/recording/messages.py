"""The three message types of the contract, without ROS: classes, CDR bytes, schema texts, hashes.

All of it comes from the `rosbags` library, imported inside functions: loading it takes 0.25 s,
and not every command needs it. The codec builds messages through a `Messages` table of
constructors, so that the same code makes these here and real ROS messages in `ldt_ros`.
"""

from __future__ import annotations

import contextlib
import functools
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import yaml

import msgs_config
from ldt_core.base.errors import RecordingError
from ldt_core.base.plain_yaml import NO_YAML, PlainDumper, load_yaml

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
STRING = "std_msgs/msg/String"
HEAD = 4  # bytes of the encapsulation before a message's CDR bytes
LITTLE_ENDIAN = b"\x01"  # second of them, as every machine that runs ROS 2 writes it
MAX_QUOTED = 60  # characters of a foreign value that a sentence quotes

# What ROS 2 writes into a recording where a QoS profile states no time.
UNLIMITED = {"sec": 9223372036, "nsec": 854775807}
# Problem types that a decoder meets in damaged bytes.
_UNDECODABLE = (
    struct.error,
    ValueError,
    IndexError,
    KeyError,
    TypeError,
    AssertionError,
    MemoryError,
)


@dataclass(frozen=True)
class Messages:
    """Constructors, by keyword, of the messages that the codec builds.

    Args:
        level: what `DiagnosticStatus.level` takes for a number (ROS wants one byte).
        doubles: what `Float64MultiArray.data` takes for a float64 array.
    """

    Float64MultiArray: Callable[..., Any]
    MultiArrayLayout: Callable[..., Any]
    MultiArrayDimension: Callable[..., Any]
    String: Callable[..., Any]
    Header: Callable[..., Any]
    Time: Callable[..., Any]
    DiagnosticArray: Callable[..., Any]
    DiagnosticStatus: Callable[..., Any]
    KeyValue: Callable[..., Any]
    level: Callable[[int], Any] = int
    doubles: Callable[[Any], Any] = lambda array: array


def typestore(kind: str = "") -> Typestore:
    """The messages that LDT sends, or all standard ones of ROS 2 Jazzy where another is asked for.

    Every command and node needs the first, and few the others, which take 0.2 s to build.
    """
    return _own_types() if kind in _own_types().fielddefs else _all_types()


@functools.cache
def _own_types() -> Typestore:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    for kind, text in msgs_config.messages().items():
        store.register(get_types_from_msg(text, kind))
    return store


@functools.cache
def _all_types() -> Typestore:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


@functools.cache
def standard() -> Messages:
    """The messages that a recording is written from when there is no ROS."""
    types = _own_types().types
    return Messages(
        Float64MultiArray=types[MULTI_ARRAY],
        MultiArrayLayout=types["std_msgs/msg/MultiArrayLayout"],
        MultiArrayDimension=types["std_msgs/msg/MultiArrayDimension"],
        String=types[STRING],
        Header=types["std_msgs/msg/Header"],
        Time=types["builtin_interfaces/msg/Time"],
        DiagnosticArray=types[DIAGNOSTICS],
        DiagnosticStatus=types["diagnostic_msgs/msg/DiagnosticStatus"],
        KeyValue=types["diagnostic_msgs/msg/KeyValue"],
    )


def serialize(message: Any) -> bytes:
    """CDR bytes of one of the `standard` messages."""
    kind = message.__msgtype__
    return bytes(typestore(kind).serialize_cdr(message, kind))


def deserialize(data: bytes, kind: str, where: str) -> Any:
    """The message in CDR bytes.

    Args:
        data: CDR with its encapsulation header.
        kind: message type, `package/msg/Name`.
        where: what to call it in messages for people.

    Raises:
        RecordingError: an unknown type, or bytes that are no such message.
    """
    types = typestore(kind)
    if kind not in types.fielddefs:
        raise RecordingError(where, "a standard ROS message type", kind)
    if len(data) <= HEAD:  # said at once: a packed chunk may hold millions of them
        raise RecordingError(where, f"a {kind} message", f"{len(data)} bytes: too short")
    from rosbags.serde import SerdeError

    try:
        return types.deserialize_cdr(data, kind)
    except (SerdeError, *_UNDECODABLE) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RecordingError(where, f"a {kind} message", f"{len(data)} bytes: {reason}") from None


def content(kind: str, data: bytes) -> bytes:
    """What a message says: its bytes rewritten, without encapsulation and zeros at the end.

    Between fields CDR leaves out up to seven bytes. Fast CDR does not touch them: what a message
    before it has left in the buffer stays there. So the same message can have other bytes when it
    is sent again, and whoever compares bytes would take it for another one.

    Args:
        kind: message type.
        data: CDR bytes; those that are no such message, or of another order, are taken as they are.
    """
    if data[1:2] == LITTLE_ENDIAN:
        with contextlib.suppress(RecordingError):
            again = serialize(deserialize(data, kind, kind))
            if len(again) <= len(data):  # a text that is cut is read as a shorter one
                data = again
    return data[HEAD:].rstrip(b"\0")


@functools.cache
def schema(kind: str, where: str = "message type") -> tuple[str, str]:
    """(full ros2msg text, RIHS01 hash) of a standard message type.

    Raises:
        RecordingError: the type is not a standard one.
    """
    types = typestore(kind)
    if kind not in types.fielddefs:
        raise RecordingError(where, "a standard ROS message type", kind)
    return types.generate_msgdef(kind, ros_version=2)[0], types.hash_rihs01(kind)


def declaration(topic: str) -> dict[str, Any] | None:
    """The entry of `topics.yaml` for an absolute or relative topic name, or None."""
    topics = msgs_config.topics()
    return topics.get(topic) or topics.get(topic.rpartition("/")[2])


def offered_qos(topic: str) -> list[dict[str, Any]]:
    """The QoS profile of a topic as rosbag2 stores it (metadata version 9)."""
    declared = declaration(topic) or {"qos": "data"}
    profile = msgs_config.qos_profiles()[declared["qos"]]
    lease = {"sec": int(profile["lease"]), "nsec": 0} if "lease" in profile else dict(UNLIMITED)
    return [
        {
            "history": profile["history"],
            "depth": profile["depth"],
            "reliability": profile["reliability"],
            "durability": profile["durability"],
            "deadline": dict(UNLIMITED),
            "lifespan": dict(UNLIMITED),
            "liveliness": "automatic",
            "liveliness_lease_duration": lease,
            "avoid_ros_namespace_conventions": False,
        }
    ]


def quoted(value: Any) -> str:
    """A foreign value as a sentence quotes it, shortened."""
    text = repr(value)
    return text if len(text) <= MAX_QUOTED else text[: MAX_QUOTED - 3] + "..."


def dump(data: Any) -> str:
    """YAML as rosbag2 writes it: block style, keys in their order."""
    return yaml.dump(data, Dumper=PlainDumper, sort_keys=False, allow_unicode=True)


def load(text: str) -> Any:
    """The data in YAML of others, see `load_yaml`; None where it is none."""
    try:
        return load_yaml(text)
    except NO_YAML:
        return None


@functools.cache
def offered_qos_text(topic: str) -> str:
    """`offered_qos` as YAML, which a channel of an MCAP file carries."""
    return dump(offered_qos(topic))
