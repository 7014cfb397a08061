"""Which experiment a stored message is about, and of what time it is, whatever else is in it."""

from __future__ import annotations

import struct
from typing import Any

from ldt_core.base.errors import RecordingError
from ldt_core.recording.codec import DECODERS
from ldt_core.recording.flat_status import ENCAPSULATION, WORD, flat_status
from ldt_core.recording.messages import DIAGNOSTICS, MULTI_ARRAY, deserialize

#: Number of an experiment, and a time [s since the epoch].
Subject = tuple[int, float]

EXACT_END = 2**53  # whole numbers up to here are exact in a float64
STAMP = struct.Struct("<iI")  # seconds, nanoseconds
HEAD = struct.Struct("<2d")  # number and start of an experiment or prediction
#: Longest time by which two statements of one time may differ [s].
TIME_TOLERANCE = 1e-3
#: First time that a stamp cannot say [s since the epoch].
STAMP_END = 2.0**31
MOST_DIMENSIONS = 8  # of a layout that is worth reading at once


def said_of(topic: str, kind: str, data: bytes) -> Subject | None:
    """What a message is about.

    Args:
        topic: its name; the last part counts.
        kind: message type.
        data: CDR bytes.

    Returns:
        The experiment's number, and its start [s]; of a status, its stamp, which is the
        experiment's end. None where the message is about none: a model, health, or other bytes.
    """
    name = topic.rpartition("/")[2]
    if name not in DECODERS or DECODERS[name][0] != kind:
        return None
    try:
        if kind == MULTI_ARRAY:
            number, time = _head(data) or _slow_head(data, topic)
        elif kind == DIAGNOSTICS:
            number, time = _status(data) or _slow_status(data, topic)
        else:
            return None
    except (RecordingError, ValueError, IndexError):
        return None
    if not (1 <= number < EXACT_END and number == int(number)):
        return None
    return int(number), time


def number_of(topic: str, kind: str, data: bytes) -> int | None:
    """The experiment's number of `said_of`."""
    about = said_of(topic, kind, data)
    return None if about is None else about[0]


def agree(stamp: float, time: float) -> bool:
    """Whether a stamp says this time [s since the epoch], as far as stamps can."""
    return not 0 < time < STAMP_END or abs(stamp - time) <= TIME_TOLERANCE


def _head(data: bytes) -> tuple[float, float] | None:
    """The first two numbers of an array out of its bytes; None where they have to be looked at."""
    if data[: len(ENCAPSULATION)] != ENCAPSULATION:
        return None
    try:
        at = len(ENCAPSULATION)
        (dimensions,) = WORD.unpack_from(data, at)
        if dimensions > MOST_DIMENSIONS:
            return None
        at += WORD.size
        for _ in range(dimensions):
            (length,) = WORD.unpack_from(data, at)
            end = at + WORD.size + length
            if not length or data[end - 1]:
                return None
            data[at + WORD.size : end].decode()
            at = (end + 3 & ~3) + 2 * WORD.size  # behind size and stride
        (count,) = WORD.unpack_from(data, at + WORD.size)  # behind the offset
        at += 2 * WORD.size
    except (struct.error, IndexError, ValueError):
        return None
    return None if count < 2 else _doubles(data, at, count)


def _doubles(data: bytes, at: int, count: int) -> tuple[float, float] | None:
    """Numbers are aligned to eight bytes behind the encapsulation, and end the message."""
    at += (len(ENCAPSULATION) - at) % 8
    if at + 8 * count != len(data):
        return None
    number, start = HEAD.unpack_from(data, at)
    return number, start


def _slow_head(data: bytes, topic: str) -> tuple[float, float]:
    numbers = deserialize(data, MULTI_ARRAY, topic).data
    return float(numbers[0]), float(numbers[1]) if len(numbers) > 1 else 0.0


def _status(data: bytes) -> tuple[float, float] | None:
    status = flat_status(data)
    if status is None:
        return None
    seconds, nanoseconds = STAMP.unpack_from(data, len(ENCAPSULATION))
    text = next((value for key, value in status.values if key == "experiment"), "0")
    return int(text), seconds + 1e-9 * nanoseconds


def _slow_status(data: bytes, topic: str) -> tuple[float, float]:
    message: Any = deserialize(data, DIAGNOSTICS, topic)
    texts = (v.value for s in message.status for v in s.values if v.key == "experiment")
    stamp = message.header.stamp
    return int(next(texts, 0)), stamp.sec + 1e-9 * stamp.nanosec
