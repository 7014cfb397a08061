"""Numbers out of any recording of standard ROS messages: `/topic.field[index]`."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ldt_core.base.errors import OptionError, RecordingError, did_you_mean
from ldt_core.base.sentences import counted, listed
from ldt_core.recording.messages import deserialize, quoted
from ldt_core.recording.storage import Storage
from ldt_core.segmenter.resampling import Series

FIELD = re.compile(r"(?P<topic>/[^.\[\]]+)\.(?P<steps>.+)")
STEP = re.compile(r"([A-Za-z]\w*)((?:\[\d+\])*)")


class FieldPath(NamedTuple):
    """A field of a topic's messages."""

    text: str
    topic: str
    steps: tuple[str | int, ...]


def parse_field_path(option: str, text: str) -> FieldPath:
    """`/topic.field[index]`, with fields in fields (`/imu.angular_velocity.z`).

    Raises:
        OptionError: something else.
    """
    match = FIELD.fullmatch(text)
    steps: list[str | int] = []
    for part in match["steps"].split(".") if match else [""]:
        step = STEP.fullmatch(part)
        if step is None:
            expected = "/topic.field[index] of a foreign bag (ldt info lists the topics)"
            raise OptionError(option, expected, repr(text))
        steps.append(step[1])
        steps.extend(int(i) for i in re.findall(r"\d+", step[2]))
    assert match is not None
    return FieldPath(text, match["topic"], tuple(steps))


def read_fields(
    storage: Storage, sources: Mapping[str, FieldPath]
) -> tuple[dict[str, Series], str]:
    """Series by name, and a sentence on their times, a warning where these differ in kind.

    The time of a sample is the stamp in its message's header, or the time of reception if not all
    messages of the topic have one.

    Args:
        storage: the recording.
        sources: name → field.

    Raises:
        RecordingError: a topic or field that is not there, or a value that is no finite number.
    """
    for source in sources.values():
        if source.topic not in storage.topics:
            expected = did_you_mean(source.topic, storage.topics)
            raise RecordingError(f"{storage.path}, topic", expected, repr(source.topic))
    values: dict[str, list[float]] = {name: [] for name in sources}
    stamps: dict[str, list[float]] = {s.topic: [] for s in sources.values()}
    received: dict[str, list[float]] = {s.topic: [] for s in sources.values()}
    for raw in storage.messages(list(stamps)):
        count = len(received[raw.topic]) + 1
        where = f"{storage.path}, {raw.topic}, message {count}"
        message = deserialize(raw.data, raw.kind, where)
        received[raw.topic].append(raw.time_ns * 1e-9)
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        stamps[raw.topic].append(0.0 if stamp is None else seconds(stamp))
        for name, source in sources.items():
            if source.topic == raw.topic:
                values[name].append(number_in(where, message, source.steps))
    series, stamped, some = {}, {}, False
    for name, source in sources.items():
        if not values[name]:
            got = "; ".join(["none", *storage.notes])
            raise RecordingError(f"{storage.path}, {source.topic}", "messages", got)
        stamped[name] = min(stamps[source.topic]) > 0
        some = some or (max(stamps[source.topic]) > 0 and not stamped[name])
        time = stamps[source.topic] if stamped[name] else received[source.topic]
        series[name] = Series(np.array(time), np.array(values[name]), _place(source.topic))
    return series, _timed(stamped, some)


def _timed(stamped: Mapping[str, bool], some: bool) -> str:
    """Which times are which.

    Args:
        stamped: by name of the series.
        some: whether a topic has messages with a stamp and others.
    """
    reception = "reception times" + ", as not all messages of a topic have a stamp" * some
    by_stamp, others = ([n for n, has in stamped.items() if has is kind] for kind in (True, False))
    if not (by_stamp and others):
        return f"times are {reception if others else 'header stamps'}"
    return (
        f"beware: times of the {listed(by_stamp)} are header stamps, those of the {listed(others)} "
        f"{reception}; a delay between them looks like another machine"
    )


def _place(topic: str) -> Callable[[int], str]:
    return lambda index: f"{topic}, message {index + 1}"


def seconds(stamp: Any) -> float:
    """A builtin_interfaces Time or Duration in seconds."""
    return stamp.sec + stamp.nanosec * 1e-9


def number_in(where: str, message: Any, steps: tuple[str | int, ...]) -> float:
    """The number at the end of a way of fields and indices through a message, of ROS's or ours.

    Raises:
        RecordingError: no such field or element, or no finite number.
    """
    value, way = message, ""
    for step in steps:
        if isinstance(step, int):
            try:
                value = value[step]
            except (IndexError, TypeError, KeyError):
                size = counted(len(value), "value") if hasattr(value, "__len__") else "no list"
                raise RecordingError(f"{where}, {way}", f"an element [{step}]", size) from None
            way += f"[{step}]"
        else:
            known = _fields(value)
            if step not in known:
                got = repr(step) if known else f"{step!r} of {quoted(value)}"
                raise RecordingError(f"{where}, {way or 'field'}", did_you_mean(step, known), got)
            value = getattr(value, step)
            way += f".{step}" if way else step
    if hasattr(value, "sec") and hasattr(value, "nanosec"):
        return seconds(value)
    if not isinstance(value, int | float | np.number | np.bool_):
        size = (
            f"{counted(len(value), 'value')}; choose one with [index]"
            if hasattr(value, "__len__")
            else ""
        )
        raise RecordingError(f"{where}, {way}", "a number", size or quoted(value))
    if not np.isfinite(value):
        raise RecordingError(f"{where}, {way}", "a finite number", value)
    return float(value)


def _fields(message: Any) -> list[str]:
    """Names of a message's fields; none for what is no message."""
    if hasattr(message, "get_fields_and_field_types"):  # as rclpy has them
        return list(message.get_fields_and_field_types())
    return [n for n in getattr(message, "__dataclass_fields__", ()) if n[0] != "_"]
