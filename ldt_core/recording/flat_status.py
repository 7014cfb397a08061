"""A status out of its CDR bytes at once: a tenth of the time of making the message first.

It knows the bytes that ROS 2 and LDT write, little end first, of one status. Of all others it says
nothing: whoever asks decodes the message then, and learns what is wrong with it.
"""

from __future__ import annotations

import struct
import sys
from typing import NamedTuple

ENCAPSULATION = b"\0\1\0\0"  # CDR, little end first
WORD = struct.Struct("<I")
COUNTED = struct.Struct("<IB")  # how many statuses, and the level of the first
FRAME = 12  # byte at which the header's frame begins, behind encapsulation and stamp


class FlatStatus(NamedTuple):
    """The one status of a DiagnosticArray, without its name and machine."""

    level: int
    message: str
    values: list[tuple[str, str]]


def flat_status(data: bytes) -> FlatStatus | None:
    """The status in these bytes; None where they are others."""
    if data[: len(ENCAPSULATION)] != ENCAPSULATION:
        return None
    texts: list[bytes] = []
    try:
        at = _texts(data, FRAME, 1, texts)
        count, level = COUNTED.unpack_from(data, at)
        at = _texts(data, at + 8, 3, texts)  # three bytes fill up behind the level
        (pairs,) = WORD.unpack_from(data, at)
        if count != 1 or pairs > len(data):
            return None
        at = _texts(data, at + 4, 2 * pairs, texts)
        # Decoded at once; a text with a zero in it makes more of them.
        _, _, message, _, *rest = b"\0".join(texts).decode().split("\0")
    except (struct.error, IndexError, ValueError):
        return None
    if len(rest) != 2 * pairs or not at - 4 < len(data) <= at:
        return None
    # One text a key, however many records are held: a page holds 100,000.
    return FlatStatus(
        level, message, list(zip(map(sys.intern, rest[::2]), rest[1::2], strict=True))
    )


def _texts(data: bytes, at: int, count: int, found: list[bytes]) -> int:
    """So many texts are added; where the next field begins, at a multiple of four bytes."""
    for _ in range(count):
        (length,) = WORD.unpack_from(data, at)
        end = at + 3 + length
        if not length or data[end]:
            raise ValueError("a text without an end")
        found.append(data[at + 4 : end])
        at = (end + 4) & ~3
    return at
