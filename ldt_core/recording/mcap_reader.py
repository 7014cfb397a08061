"""Reading one MCAP file, whatever happened to it.

A file is read as a stream, record by record, in bounded memory, and each stretch that is damaged is
passed over: what begins behind it is found by the shape of a chunk, whose lengths have to agree
and whose checksum has to hold. Every byte that is left out is told.

The readers of the `mcap` library end at the first damaged byte, so they serve whole files alone.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import IO, Any, NamedTuple, cast

import zstandard
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Message, Schema, Statistics

from ldt_core.recording.mcap_records import (
    DAMAGE_ERRORS,
    FOOTER,
    HEAD,
    LIBRARY,
    MCAP_MAGIC,
    MESSAGE,
    PRIVATE_OPCODES,
    ZSTD_MAGIC,
    ByteStream,
    is_index,
    located,
    message_in,
    next_record,
    opened,
    parse,
    reason,
)

#: Number of a channel in the file → the channel, and its schema if it has one.
Described = dict[int, tuple[Channel, Schema | None]]


class ChannelMessage(NamedTuple):
    """A message, and what the file says of its channel."""

    channel: Channel
    schema: Schema | None
    message: Message


class McapSummary(NamedTuple):
    """What the index at the end of a file says."""

    channels: Described
    statistics: Statistics | None
    chunks: list[ChunkIndex]


class TolerantMcapReader:
    """One MCAP file, perhaps compressed with zstd as a whole.

    Args:
        path: of the file.
        note: told of all that is damaged, a sentence each.
        declared: gives the channels as the recording's metadata.yaml numbers them, for a file of
            LDT's whose own description is lost.
    """

    def __init__(
        self, path: Path, note: Callable[[str], None], declared: Callable[[], Described] = dict
    ) -> None:
        self.path, self._note, self._declared = path, note, declared
        with path.open("rb") as stream:
            self._zipped = stream.read(len(ZSTD_MAGIC)) == ZSTD_MAGIC
        #: As the header names the writer; known when the file has been read.
        self.library = ""
        #: Channels that messages were found of, or that were described; known like that, too.
        self.described: Described = {}
        # Numbers of channels whose messages nobody wants at present.
        self._left_out: set[int] = set()

    def summary(self, places: bool = True) -> McapSummary | None:
        """The index at the end of the file, None when there is none to rely on.

        Args:
            places: of the chunks as well, of which there may be twenty thousand.
        """
        if self._zipped:
            return None
        with self.path.open("rb") as stream:
            size = stream.seek(0, io.SEEK_END)
            tail = min(size, HEAD.size + FOOTER.size + len(MCAP_MAGIC))
            stream.seek(-tail, io.SEEK_END)
            end = stream.read()
            if not end.endswith(MCAP_MAGIC) or end[: HEAD.size] != HEAD.pack(
                Opcode.FOOTER, FOOTER.size
            ):
                self._note(
                    f"{self.path}: has no end (cut off, or its writer was killed); read up to there"
                )
                return None
            begin, _, crc = FOOTER.unpack(end[HEAD.size : HEAD.size + FOOTER.size])
            if begin == 0:
                return None
            if not begin < size - tail:
                self._note(f"{self.path}: its index is damaged (no place); read without it")
                return None
            stream.seek(begin)
            data = stream.read()
        if crc and zlib.crc32(data[: -4 - len(MCAP_MAGIC)]) != crc:
            self._note(f"{self.path}: its index is damaged; read without it")
            return None
        try:
            return _summary(data[: len(data) - tail], places)
        except DAMAGE_ERRORS as error:
            self._note(f"{self.path}: its index is damaged ({reason(error)}); read without it")
            return None

    def channels(self) -> Described:
        """All channels that the file describes, by its index or else by its every byte."""
        summary = self.summary(places=False)
        return summary.channels if summary and summary.channels else _described(self._records())

    def first_channels(self) -> Described:
        """The same by the first chunk of a file without an index; few bytes are read.

        In a file that is being written a channel that was described late may be missing.
        """
        summary = self.summary(places=False)
        if summary:
            return summary.channels
        chunks = (body for opcode, body in self._framed() if opcode == Opcode.CHUNK)
        first: Iterable[Any] = next(chunks, ())
        return self._spare() | _described(first)

    def messages(
        self, begin: int = 0, topics: Collection[str] | None = None
    ) -> Iterator[ChannelMessage]:
        """Messages in recorded order; what is damaged is left out and noted.

        Args:
            begin: byte before which nothing is read, the first one of a chunk.
            topics: of which messages come; None for all.
        """
        schemas: dict[int, Schema] = {}
        self._left_out.clear()
        described = self.described = self.first_channels() if begin else {}
        spare: Described | None = None
        for record in self._records(begin):
            if isinstance(record, Message):
                channel = described.get(record.channel_id)
                if channel is None:
                    spare = self._spare() if spare is None else spare
                    channel = spare.get(record.channel_id)
                    if channel is not None:
                        described[record.channel_id] = channel
                if channel is None:
                    self._note(
                        f"{self.path}: messages of a channel that is not described were left out"
                    )
                    continue
                if topics is None or channel[0].topic in topics:
                    yield ChannelMessage(*channel, record)
                else:
                    self._left_out.add(record.channel_id)
            elif isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                described[record.id] = record, schemas.get(record.schema_id)
                self._left_out.discard(record.id)

    def messages_of(self, topics: Collection[str]) -> Iterator[ChannelMessage]:
        """Messages of some topics by the index, without reading what has none of them.

        Where there is no index, or it does not lead to whole chunks, all of the file is read.
        """
        about = self.summary(places=False)
        if about and about.statistics:
            counts = about.statistics.channel_message_counts
            if not any(counts.get(n) for n, d in about.channels.items() if d[0].topic in topics):
                return
        summary = self.summary()
        if summary is not None and summary.chunks:
            try:
                yield from self._by_index(summary, topics)
                return
            except DAMAGE_ERRORS as error:
                self._note(f"{self.path}: its index is wrong ({reason(error)}); read without it")
        yield from self.messages(topics=topics)

    def _by_index(self, summary: McapSummary, topics: Collection[str]) -> list[ChannelMessage]:
        wanted = {n: d for n, d in summary.channels.items() if d[0].topic in topics}
        found = []
        with self.path.open("rb") as stream:
            for chunk in summary.chunks:
                if wanted.keys().isdisjoint(chunk.message_index_offsets):
                    continue
                stream.seek(chunk.chunk_start_offset)
                opcode, body = next_record(ByteStream(stream, chunk.chunk_length))
                if opcode != Opcode.CHUNK:
                    raise ValueError(f"no chunk at byte {chunk.chunk_start_offset}")
                for record in opened(body):
                    if isinstance(record, Message) and record.channel_id in wanted:
                        found.append(ChannelMessage(*wanted[record.channel_id], record))
        return found

    def _spare(self) -> Described:
        """Channels from elsewhere than the chunks, for when the one that had them is lost."""
        summary = self.summary(places=False)
        if summary:
            return summary.channels
        return self._declared() if self.library == LIBRARY else {}

    def _records(self, begin: int = 0) -> Iterator[Schema | Channel | Message]:
        for opcode, body in self._framed(begin):
            if opcode == Opcode.CHUNK:
                yield from body
            elif opcode == Opcode.MESSAGE:
                yield message_in(body)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                yield parse(opcode, body)

    def _framed(self, begin: int = 0) -> Iterator[tuple[int, Any]]:
        """(opcode, content) of the records before the index; of a chunk, the records in it."""
        with self.path.open("rb") as plain:
            size = None if self._zipped else plain.seek(0, io.SEEK_END)
            plain.seek(0)
            stream: IO[bytes] = plain
            if self._zipped:
                stream = cast("IO[bytes]", zstandard.ZstdDecompressor().stream_reader(plain))
            places = ByteStream(stream, size)
            if not begin or places.find_chunk(begin) is not None:
                yield from self._walk(places)

    def _walk(self, stream: ByteStream) -> Iterator[tuple[int, Any]]:
        whole = stream.at == 0  # nothing was left out so far
        chunked = not whole  # whether there was a chunk
        try:
            if whole and stream.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
                whole = False
                self._note(f"{self.path}: its first bytes are damaged")
            while True:
                at, crc = stream.at, stream.crc
                try:
                    opcode, body = next_record(stream)
                    _check_place(opcode, body, at, chunked)
                    if opcode >= PRIVATE_OPCODES:
                        self._note(f"{self.path}: a record of another application was left out")
                    elif opcode == Opcode.DATA_END:
                        (said,) = struct.unpack("<L", body)
                        if whole and said and said != crc:
                            self._note(f"{self.path}: damaged outside the messages; they are whole")
                        return
                    elif opcode == Opcode.FOOTER:
                        return
                    elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.HEADER):
                        record = parse(opcode, body)
                        if opcode == Opcode.HEADER:
                            self.library = record.library
                    elif opcode == Opcode.MESSAGE:
                        MESSAGE.unpack_from(body)
                except DAMAGE_ERRORS as error:
                    whole = False
                    if not self._pass_over(stream, at, error):
                        return
                    continue
                content: Any = body
                if opcode == Opcode.CHUNK:
                    chunked = True
                    try:
                        content = self._told(opened(body, self._left_out), stream.at)
                    except DAMAGE_ERRORS as error:
                        whole = False
                        self._note(
                            f"{self.path}: a chunk of {len(body)} bytes before byte {stream.at} "
                            f"is damaged ({reason(error)}); left out"
                        )
                        continue
                yield opcode, content
        except DAMAGE_ERRORS as error:
            self._note(
                f"{self.path}: damaged at byte {stream.at} ({reason(error)}); read up to there"
            )

    def _told(self, records: Iterator[Any], at: int) -> Iterator[Any]:
        """The records of a chunk; what is behind a damaged one is left out, with a note."""
        try:
            yield from records
        except DAMAGE_ERRORS as error:
            words = f"is damaged inside ({reason(error)}); the rest of it is left out"
            self._note(f"{self.path}: a chunk before byte {at} {words}")

    def _pass_over(self, stream: ByteStream, at: int, error: Exception) -> bool:
        """Go on behind damage; False when nothing is found there."""
        behind = stream.find_chunk(at + 1)
        if behind is not None:
            self._note(
                f"{self.path}: damaged at byte {at} ({reason(error)}); {behind - at} bytes left out"
            )
            return True
        if isinstance(error, EndOfFile):
            self._note(f"{self.path}: ends in the middle; read up to there")
        else:
            self._note(f"{self.path}: damaged at byte {at} ({reason(error)}); read up to there")
        return False


def _check_place(opcode: int, body: bytes, at: int, chunked: bool) -> None:
    """Refuse what one flipped bit makes of another record: there is no checksum on its kind."""
    if (at == len(MCAP_MAGIC)) != (opcode == Opcode.HEADER):
        raise ValueError("no header at the beginning, or one behind it")
    if chunked and opcode == Opcode.MESSAGE and is_index(body):
        raise ValueError("a message that is an index")


def _described(records: Iterable[Any]) -> Described:
    """The channels among records, each with the schema that came before it."""
    schemas: dict[int, Schema] = {}
    channels: Described = {}
    for record in records:
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record, schemas.get(record.schema_id)
    return channels


def _summary(data: bytes, places: bool) -> McapSummary:
    records = []
    for _, record in located(data):
        if not places and isinstance(record, ChunkIndex):
            break  # they come last of what is looked at here
        records.append(record)
    statistics = [r for r in records if isinstance(r, Statistics)]
    chunks = [r for r in records if isinstance(r, ChunkIndex)]
    # Schemas first: an index may have its groups of records in any order.
    channels = _described(sorted(records, key=lambda r: not isinstance(r, Schema)))
    return McapSummary(channels, statistics[0] if statistics else None, chunks)
