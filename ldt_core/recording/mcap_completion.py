"""Giving a file of a killed writer the end that it lacks: its index, in place, after one reading.

Only what comes behind the last whole chunk changes. Where anything before that is damaged the file
has to be written anew (`ldt_core.recording.repair`).
"""

from __future__ import annotations

import contextlib
import os
import zlib
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from ldt_core.recording.mcap_records import (
    CHUNK,
    DAMAGE_ERRORS,
    FOOTER,
    HEAD,
    INDEX,
    MCAP_MAGIC,
    ByteStream,
    content,
    located,
    next_record,
)
from ldt_core.recording.metadata import FileInformation, bag_information, channel_entry, text_of
from ldt_core.recording.storage import free_name

TAIL_SUFFIX = ".tail"  # behind the name of a file: the first bytes of a chunk that was cut off

Take = Callable[[Channel, Schema | None, Message], None]


class _Survey:
    """What one reading of a file without an end shows, up to its last whole chunk."""

    def __init__(self) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.chunks: list[ChunkIndex] = []
        self.indexes: dict[int, bytes] = {}  # of the last chunk, by channel
        self.pending: set[int] = set()  # channels of which that has not come
        self.counts: Counter[int] = Counter()
        self.facts = FileInformation("")
        self.end = self.crc = 0  # behind the last chunk, and the checksum up to there
        self.stop = 0  # behind the last record that is whole


def complete_file(file: Path, custom: Mapping[str, str], take: Take) -> bool:
    """Write the index of a file that has none.

    Args:
        file: an MCAP file that nobody is writing.
        custom: what the end of a complete file says of its recording, beside what rosbag2 needs.
        take: given each message of the file.

    Returns:
        whether it has its end now; else something before it is damaged, and it is as it was.

    Raises:
        OSError: the file cannot be read or written.
    """
    with file.open("rb") as stream:
        survey = _survey(ByteStream(stream, file.stat().st_size), take)
        if survey is None:
            return False
        stream.seek(survey.stop)
        rest = stream.read()
    if rest[:1] == bytes([Opcode.CHUNK]):
        _keep(file.with_name(file.name + TAIL_SUFFIX), rest)
    survey.facts = survey.facts._replace(name=file.name)
    with file.open("rb") as stream:
        stream.seek(survey.end)
        before = stream.read()
    try:
        _replace_end(file, survey.end, _end(survey, custom))
    except OSError:
        with contextlib.suppress(OSError):
            _replace_end(file, survey.end, before)
        raise
    return True


def _replace_end(file: Path, at: int, data: bytes) -> None:
    with file.open("r+b", buffering=0) as stream:
        stream.truncate(at)
        stream.seek(at)
        while data:
            data = data[stream.write(data) :]
        os.fsync(stream.fileno())


def _survey(stream: ByteStream, take: Take) -> _Survey | None:
    """None where something is damaged before the end."""
    found = _Survey()
    try:
        if stream.read(len(MCAP_MAGIC)) != MCAP_MAGIC or next_record(stream)[0] != Opcode.HEADER:
            return None
    except DAMAGE_ERRORS:
        return None
    found.end, found.crc, found.stop = stream.at, stream.crc, stream.at
    while True:
        try:
            opcode, body = next_record(stream)
            if opcode == Opcode.CHUNK:
                if found.pending:
                    return None  # the chunk before lacks a part of its index
                _take_chunk(found, body, stream.at, take)
                found.end, found.crc = stream.at, stream.crc
            elif opcode != Opcode.MESSAGE_INDEX or not _take_index(found, body, stream.at):
                break  # its writer was killed while it wrote the end, or this is damage
        except KeyError:
            return None  # a channel that is not described here
        except DAMAGE_ERRORS:
            break
        found.stop = stream.at
    return found if stream.find_chunk(found.stop + 1) is None else None


def _take_chunk(found: _Survey, body: bytes, end: int, take: Take) -> None:
    indexes: dict[int, list[tuple[int, int]]] = {}
    for at, record in located(content(body)):
        if isinstance(record, Message):
            indexes.setdefault(record.channel_id, []).append((record.log_time, at))
            found.counts[record.channel_id] += 1
            found.facts = found.facts.with_message(record.log_time)
            channel = found.channels[record.channel_id]
            take(channel, found.schemas.get(channel.schema_id), record)
        elif isinstance(record, Schema):
            found.schemas[record.id] = record
        elif isinstance(record, Channel):
            found.channels[record.id] = record
    found.indexes = {
        channel: _bytes(MessageIndex(channel_id=channel, records=entries))
        for channel, entries in indexes.items()
    }
    found.pending = set(indexes)
    first, last, size, _, named = CHUNK.unpack_from(body)
    length = HEAD.size + len(body)
    found.chunks.append(
        ChunkIndex(
            chunk_length=length,
            chunk_start_offset=end - length,
            compression=body[CHUNK.size : CHUNK.size + named].decode(),
            compressed_size=len(body) - CHUNK.size - named - 8,
            message_end_time=last,
            message_index_length=0,
            message_index_offsets={},
            message_start_time=first,
            uncompressed_size=size,
        )
    )


def _take_index(found: _Survey, body: bytes, end: int) -> bool:
    """Whether it is what belongs there."""
    (channel, _) = INDEX.unpack_from(body)
    if channel not in found.pending or found.indexes[channel][HEAD.size :] != body:
        return False
    found.pending.remove(channel)
    _place_index(found.chunks[-1], channel, end - HEAD.size - len(body), end)
    return True


def _place_index(chunk: ChunkIndex, channel: int, at: int, end: int) -> None:
    chunk.message_index_offsets[channel] = at
    chunk.message_index_length = end - chunk.chunk_start_offset - chunk.chunk_length


def _end(found: _Survey, custom: Mapping[str, str]) -> bytes:
    """What comes behind the last chunk: its index, the metadata, and the summary."""
    data = b""
    if found.chunks:
        for channel, index in found.indexes.items():
            at = found.end + len(data)
            data += index
            _place_index(found.chunks[-1], channel, at, found.end + len(data))
    described = {n: (c, found.schemas.get(c.schema_id)) for n, c in found.channels.items()}
    topics = [
        channel_entry(*described[n]) | {"message_count": found.counts[n]} for n in sorted(described)
    ]
    text = text_of(bag_information(topics, [found.facts], custom))
    metadata = Metadata(name="rosbag2", metadata={"serialized_metadata": text})
    place = MetadataIndex(found.end + len(data), len(_bytes(metadata)), "rosbag2")
    data += _bytes(metadata)
    data += _bytes(DataEnd(zlib.crc32(data, found.crc)))
    return data + _summary(found, place, found.end + len(data))


def _summary(found: _Survey, metadata: MetadataIndex, begin: int) -> bytes:
    """The records behind the data, in the groups and the order of the `mcap` library."""
    statistics = Statistics(
        attachment_count=0,
        channel_count=len(found.channels),
        channel_message_counts=dict(found.counts),
        chunk_count=len(found.chunks),
        message_count=found.facts.messages,
        metadata_count=1,
        message_start_time=max(found.facts.first, 0),
        message_end_time=max(found.facts.last, 0),
        schema_count=len(found.schemas),
    )
    groups: dict[Opcode, list[Any]] = {
        Opcode.SCHEMA: list(found.schemas.values()),
        Opcode.CHANNEL: list(found.channels.values()),
        Opcode.STATISTICS: [statistics],
        Opcode.CHUNK_INDEX: found.chunks,
        Opcode.METADATA_INDEX: [metadata],
    }
    data, offsets = b"", b""
    for opcode, records in groups.items():
        group = b"".join(map(_bytes, records))
        offsets += _bytes(SummaryOffset(opcode, begin + len(data), len(group)))
        data += group
    behind = begin + len(data)
    data += offsets
    head = HEAD.pack(Opcode.FOOTER, FOOTER.size) + FOOTER.pack(begin, behind, 0)[:-4]
    crc = zlib.crc32(data + head)
    return data + _bytes(Footer(begin, behind, crc)) + MCAP_MAGIC


def _bytes(record: Any) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


def _keep(file: Path, data: bytes) -> None:
    """Bytes that are cut off, forced onto the medium, under a name that is free."""
    with free_name(file).open("xb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())
