"""CDR bytes as if every serializer wrote zeros where it writes nothing.

Between fields CDR leaves out up to seven bytes. Fast CDR does not touch them: what a message before
it has left in the buffer stays there. So the same message can have other bytes when it is sent
again, and whoever compares bytes would take it for another one.

Reference: OMG DDS-XTypes 1.3, section 7.4.1.1 (XCDR version 1, which ROS 2 sends).
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from ldt_core.recording.messages import DIAGNOSTICS, MULTI_ARRAY, STRING

HEAD = 4  # bytes of the encapsulation, from behind which alignment counts
LITTLE_ENDIAN = 1  # second byte of it, as every machine that runs ROS 2 writes it
_COUNT = struct.Struct("<I")


class _Walk:
    """Goes through the fields of a message and zeroes what is between them."""

    def __init__(self, data: bytes) -> None:
        self.data = bytearray(data)
        self.at = HEAD

    def field(self, size: int, alignment: int) -> int:
        """Pass over a field; where it begins."""
        begin = self.at + -(self.at - HEAD) % alignment
        if begin + size > len(self.data):
            raise ValueError("a field that reaches beyond the end")
        self.data[self.at : begin] = bytes(begin - self.at)
        self.at = begin + size
        return begin

    def count(self) -> int:
        """Pass over the length of a text or sequence; that length."""
        (count,) = _COUNT.unpack_from(self.data, self.field(4, 4))
        return int(count)

    def text(self) -> None:
        """Pass over a text."""
        self.field(self.count(), 1)


def _string(walk: _Walk) -> None:
    walk.text()


def _multi_array(walk: _Walk) -> None:
    for _ in range(walk.count()):  # dimensions: label, size, stride
        walk.text()
        walk.field(8, 4)
    walk.field(4, 4)  # data_offset
    if doubles := walk.count():
        walk.field(8 * doubles, 8)


def _diagnostics(walk: _Walk) -> None:
    walk.field(8, 4)  # stamp
    walk.text()
    for _ in range(walk.count()):
        walk.field(1, 1)  # level
        for _ in range(3):  # name, message, hardware_id
            walk.text()
        for _ in range(2 * walk.count()):  # keys and values
            walk.text()


_WALKS: dict[str, Callable[[_Walk], None]] = {
    STRING: _string,
    MULTI_ARRAY: _multi_array,
    DIAGNOSTICS: _diagnostics,
}


def content(kind: str, data: bytes) -> bytes:
    """What a message says: its bytes without encapsulation, padding zeroed, none at the end.

    Args:
        kind: message type.
        data: CDR bytes; those that are no such message, or of another order, come back as they
            are, but for zeros at the end.
    """
    if kind in _WALKS and data[1:2] == bytes([LITTLE_ENDIAN]):
        walk = _Walk(data)
        try:
            _WALKS[kind](walk)
        except ValueError:
            pass
        else:
            return bytes(memoryview(walk.data)[HEAD : walk.at])
    return data[HEAD:].rstrip(b"\0")
