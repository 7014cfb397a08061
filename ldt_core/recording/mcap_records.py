"""The records of an MCAP file as bytes: whether they can be right, and what is in them.

As the format defines them (https://mcap.dev/spec).
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Callable, Container, Iterator
from typing import IO, Any, cast

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Header, Message, Schema, Statistics

MCAP_MAGIC = b"\x89MCAP0\r\n"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
LIBRARY = "ldt"  # what a file that LDT wrote names as its writer
FREE_CHUNK = 100 << 20  # bytes of a chunk that unpack from anything: the longest message, constant
MOST_RATIO = 100  # of a larger chunk to what is packed; recordings reach 20
MAX_CHUNK = 1 << 30  # bytes of one record or chunk; rosbag2 cuts at 1 MB, a larger claim is damage
HEAD = struct.Struct("<BQ")  # of every record: what it is, and how many bytes follow
CHUNK = struct.Struct("<QQQIL")  # first and last time, size, checksum, length of the method's name
MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, time of recording, time of publishing
MESSAGE_OPCODE = int(Opcode.MESSAGE)  # compared for each message, twice as fast
CHANNEL_NUMBER = struct.Struct("<H")  # what a message begins with
INDEX = struct.Struct("<HL")  # channel, bytes of the entries that follow
FOOTER = struct.Struct("<QQI")  # where the summary and its offsets begin, checksum
# A chunk's start as it is looked for behind damage: opcode, length, fixed fields, compression.
CHUNK_START = re.compile(rb"\x06(?=.{36}(?:\x04\0\0\0zstd|\x03\0\0\0lz4|\0\0\0\0))", re.DOTALL)
SEARCH_WINDOW = 1 << 22  # bytes that are searched at once
WINDOW_OVERLAP = 64  # bytes by which windows overlap, more than CHUNK_START looks at
#: What the mcap and compression libraries raise on damaged bytes.
DAMAGE_ERRORS = (
    McapError,
    struct.error,
    zstandard.ZstdError,
    RuntimeError,
    ValueError,
    KeyError,
    MemoryError,
    OverflowError,
)
_READ: dict[int, Callable[[ReadDataStream], Any]] = {
    Opcode.HEADER: Header.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.STATISTICS: Statistics.read,
    Opcode.CHUNK_INDEX: ChunkIndex.read,
}
PRIVATE_OPCODES = 0x80  # from here on an opcode is an application's own


class ByteStream:
    """A stream that gives all the bytes asked for, and knows where it is.

    Args:
        stream: at its beginning.
        size: its bytes; None when that is unknown, and there is no way back.
    """

    def __init__(self, stream: IO[bytes], size: int | None) -> None:
        self._stream, self._size = stream, size
        self.at = self.crc = 0

    def read(self, size: int) -> bytes:
        """Raises EndOfFile when there are fewer."""
        if self._size is not None and size > self._size - self.at:
            raise EndOfFile
        data = self._stream.read(size)
        self.at += len(data)
        self.crc = zlib.crc32(data, self.crc)
        if len(data) < size:
            raise EndOfFile
        return data

    def find_chunk(self, at: int) -> int | None:
        """Go to the next chunk that begins there or later; None when there is none."""
        if self._size is None:
            return None
        while at < self._size:
            self._stream.seek(at)
            window = self._stream.read(SEARCH_WINDOW + WINDOW_OVERLAP)
            for match in CHUNK_START.finditer(window):
                place = at + match.start()
                length = HEAD.unpack_from(window, match.start())[1]
                left = self._size - place - HEAD.size
                fields = window[match.start() + HEAD.size : match.start() + WINDOW_OVERLAP]
                if match.start() < SEARCH_WINDOW and length <= left and agrees(fields, length):
                    self._stream.seek(place)
                    self.at = place
                    return place
            at += SEARCH_WINDOW
        return None


def parse(opcode: int, body: bytes) -> Any:
    """The record in these bytes.

    Raises:
        ValueError: more bytes than it has, or an error of DAMAGE_ERRORS.
    """
    stream = ReadDataStream(cast("IO[bytes]", ByteStream(io.BytesIO(body), len(body))))
    record = _READ[opcode](stream)
    if stream.count != len(body):
        raise ValueError(f"{len(body) - stream.count} bytes too many in a record")
    return record


def message_in(data: bytes, begin: int = 0, end: int | None = None) -> Message:
    """The message in a record's bytes, which stand from `begin` to `end` in these."""
    channel, sequence, log_time, publish_time = MESSAGE.unpack_from(data, begin)
    return Message(channel, log_time, data[begin + MESSAGE.size : end], publish_time, sequence)


def decompress(method: str, data: bytes, size: int) -> bytes:
    """At most MAX_CHUNK bytes, and so many as stated, whatever the data claim.

    Args:
        method: "zstd", "lz4" or "" for none.
        data: what is packed.
        size: most bytes that it may come to; with lz4 one more, by which that is noticed.

    Raises:
        ValueError: it claims more, or another error of DAMAGE_ERRORS.
    """
    if size > MAX_CHUNK:
        raise ValueError(f"it claims {size} bytes")
    if method == "":
        return data
    if method == "zstd":
        claimed = zstandard.frame_content_size(data)
        if claimed > size:  # zstandard would make room for it, whatever `max_output_size` says
            raise ValueError(f"it claims {claimed} bytes")
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    if method == "lz4":
        return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    raise ValueError(f"compression {method!r} is unknown")


def reason(error: BaseException) -> str:
    """Why, in words for a person."""
    return " ".join(str(error).split()) or type(error).__name__


def next_record(stream: ByteStream) -> tuple[int, bytes]:
    """Opcode and content of the next record; an error of DAMAGE_ERRORS when it cannot be one."""
    opcode, length = HEAD.unpack(stream.read(HEAD.size))
    if length > MAX_CHUNK:
        raise ValueError(f"a record claims {length} bytes")
    body = stream.read(length)
    if not _fits(opcode, body):
        raise ValueError(f"no record, or one of a wrong length (kind {opcode}, {length} bytes)")
    return opcode, body


def _fits(opcode: int, body: bytes) -> bool:
    """Whether a record before the index may be of this kind and have this content."""
    match opcode:
        case Opcode.CHUNK:
            return agrees(body, len(body))
        case Opcode.MESSAGE:
            return len(body) >= MESSAGE.size
        case Opcode.MESSAGE_INDEX:
            return is_index(body)
        case Opcode.DATA_END:
            return len(body) == 4
        case Opcode.FOOTER:
            return len(body) == FOOTER.size
        case Opcode.HEADER | Opcode.SCHEMA | Opcode.CHANNEL | Opcode.ATTACHMENT | Opcode.METADATA:
            return True
    return opcode >= PRIVATE_OPCODES


def is_index(body: bytes) -> bool:
    """Whether the bytes of its entries follow their length."""
    return len(body) >= INDEX.size and INDEX.unpack_from(body)[1] == len(body) - INDEX.size


def agrees(fields: bytes, length: int) -> bool:
    """Whether the lengths within a chunk add up to its own.

    Args:
        fields: its content, or the first bytes of it.
        length: of the whole content.
    """
    if length < CHUNK.size + 8:
        return False
    *_, named = CHUNK.unpack_from(fields)
    if named > 4 or length < CHUNK.size + named + 8:  # "", "lz4" or "zstd"
        return False
    (data,) = struct.unpack_from("<Q", fields, CHUNK.size + named)
    return bool(length == CHUNK.size + named + 8 + data)


def opened(body: bytes, left_out: Container[int] = ()) -> Iterator[Any]:
    """The records in a chunk, made one after the other; its checksum is checked at once.

    Args:
        body: of the chunk.
        left_out: numbers of channels whose messages are passed over.
    """
    data = content(body)
    return (record for _, record in located(data, left_out))


def content(body: bytes) -> bytes:
    """What a chunk holds, with its checksum checked."""
    _, _, size, crc, named = CHUNK.unpack_from(body)
    if size > max(FREE_CHUNK, MOST_RATIO * len(body)):
        raise ValueError(f"it claims to unpack {len(body)} bytes to {size}")
    method = body[CHUNK.size : CHUNK.size + named].decode()
    data = decompress(method, body[CHUNK.size + named + 8 :], size)
    if len(data) != size:
        raise ValueError(f"{len(data)} bytes instead of {size}")
    if crc and zlib.crc32(data) != crc:
        raise ValueError("its checksum is wrong")
    return data


def located(data: bytes, left_out: Container[int] = ()) -> Iterator[tuple[int, Any]]:
    """Place and record, of those in a chunk or a summary that concern messages.

    Args:
        data: the records' bytes.
        left_out: numbers of channels whose messages are passed over; may change meanwhile.
    """
    at, size = 0, len(data)
    while at < size:
        opcode, length = HEAD.unpack_from(data, at)
        begin = at + HEAD.size
        end = begin + length
        if end > size:
            raise EndOfFile
        if opcode == MESSAGE_OPCODE:
            if length < MESSAGE.size:
                raise EndOfFile
            if CHANNEL_NUMBER.unpack_from(data, begin)[0] not in left_out:
                yield at, message_in(data, begin, end)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.CHUNK_INDEX):
            yield at, parse(opcode, data[begin:end])
        at = end
