"""The files of a recording: raw messages out of MCAP (also zstd-compressed) and SQLite.

MCAP is read as a stream, chunk by chunk, in bounded memory. A file without an end (its writer was
killed) or with broken chunks gives what is left of it, and `Storage.notes` says what is not.
"""

from __future__ import annotations

import contextlib
import io
import re
import sqlite3
import struct
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path, PurePath
from typing import IO, Any, NamedTuple, cast

import lz4.frame
import yaml
import zstandard
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Chunk, Footer, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from ldt_core.errors import RecordingError
from ldt_core.recording.messages import quoted

METADATA = "metadata.yaml"
PROFILE = "ros2"
MCAP_MAGIC = b"\x89MCAP0\r\n"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
SQLITE_MAGIC = b"SQLite format 3\x00"
ROS1_MAGIC = b"#ROSBAG V"
FOOTER_BYTES = 9 + 20  # opcode and length, then the footer's content
MAX_CHUNK = 1 << 30  # bytes of one record or chunk; rosbag2 cuts at 1 MB, a larger claim is damage
MAX_METADATA = 10_000_000  # bytes of metadata.yaml; a large one has 100 kB
# What the mcap and compression libraries raise on damaged bytes.
BROKEN = (
    McapError,
    struct.error,
    zstandard.ZstdError,
    RuntimeError,
    ValueError,
    KeyError,
    MemoryError,
    OverflowError,
)


class Raw(NamedTuple):
    """One message as it is stored: CDR bytes, and when it was received [ns since the epoch]."""

    topic: str
    kind: str
    time_ns: int
    data: bytes


class Storage:
    """A recording's files in order.

    Args:
        path: rosbag2 folder, or a bare file of one.

    Raises:
        RecordingError: nothing there, empty, or no ROS 2 recording.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._notes: dict[str, None] = {}
        self.metadata: dict[str, Any] = {}
        self.files = self._find_files()
        self.topics: dict[str, str] = {}
        for file in self.files:
            self._discover(file)

    @property
    def notes(self) -> list[str]:
        """What is damaged or missing, a sentence each; complete after all has been read."""
        return list(self._notes)

    def note(self, sentence: str) -> None:
        """Add to the notes, once."""
        self._notes[sentence] = None

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Raw]:
        """Messages of the topics (of all when None), in the order in which they were recorded."""
        per_message = str(self.metadata.get("compression_mode", "")).lower() == "message"
        for file in self.files:
            for raw in self._read(file, topics):
                yield self._unzipped(raw) if per_message else raw

    def _unzipped(self, raw: Raw) -> Raw:
        try:
            return raw._replace(data=_decompress("zstd", raw.data, MAX_CHUNK))
        except BROKEN as error:
            raise RecordingError(
                f"{self.path}, {raw.topic}", "messages compressed with zstd", _reason(error)
            ) from None

    def _find_files(self) -> list[Path]:
        path = self.path
        wanted = "a recording (a rosbag2 folder or an .mcap file)"
        try:
            if not path.exists():
                raise RecordingError(path, wanted, "no such file or folder")
            if path.is_dir():
                return self._files_of_folder()
            _magic(path)
        except OSError as error:
            raise RecordingError(path, "a readable recording", error.strerror or error) from None
        return [path]

    def _files_of_folder(self) -> list[Path]:
        listed: list[str] = []
        if (self.path / METADATA).is_file():
            self.metadata = _read_metadata(self.path / METADATA)
            names = self.metadata.get("relative_file_paths") or []
            listed = [PurePath(n).name for n in names if isinstance(n, str)]
        found = [
            f.name for f in self.path.iterdir() if re.search(r"\.(mcap|db3)(\.zstd)?$", f.name)
        ]
        # A recorder that was killed lists the files it began with, or none at all.
        files = listed + sorted((f for f in found if f not in listed), key=_natural)
        present = [self.path / f for f in files if (self.path / f).is_file()]
        if not present:
            got = "none of them" if listed else "no such file"
            expected = ", ".join(listed) or ".mcap files, as in a rosbag2 folder"
            raise RecordingError(self.path, expected, got)
        for name in files:
            if not (self.path / name).is_file():
                self.note(f"{self.path}: {METADATA} lists {name}, which is missing")
        for file in present:
            _magic(file)
        return present

    def _discover(self, file: Path) -> None:
        """Fill `topics` from one file."""
        if _magic(file) == SQLITE_MAGIC:
            try:
                found = dict(_sqlite(file, "SELECT name, type FROM topics", str, str))
            except (sqlite3.Error, ValueError) as error:
                raise RecordingError(file, "a rosbag2 SQLite file", _reason(error)) from None
        else:
            found = self._summary(file) or {c.topic: kind for c, kind in self._channels(file)}
        for topic, kind in found.items():
            known = self.topics.setdefault(topic, kind)
            if known != kind:
                raise RecordingError(f"{self.path}, {topic}", f"one message type, {known}", kind)

    def _summary(self, file: Path) -> dict[str, str] | None:
        """Topic → type from the index at the end, or None when there is none to rely on."""
        if _magic(file) == ZSTD_MAGIC:
            return None
        with file.open("rb") as stream:
            size = stream.seek(0, io.SEEK_END)
            tail = min(size, FOOTER_BYTES + len(MCAP_MAGIC))
            stream.seek(-tail, io.SEEK_END)
            end = stream.read()
            if not end.endswith(MCAP_MAGIC) or end[:9] != struct.pack("<BQ", 2, 20):
                self.note(
                    f"{file}: has no end (cut off, or its writer was killed); read up to there"
                )
                return None
            begin, _, crc = struct.unpack("<QQI", end[9:FOOTER_BYTES])
            if not 0 < begin < size - tail:
                return None
            stream.seek(begin)
            summary = stream.read()
        if crc and zlib.crc32(summary[: -4 - len(MCAP_MAGIC)]) != crc:
            self.note(f"{file}: its index is damaged; read without it")
            return None
        try:
            exact = cast("IO[bytes]", _Exact(io.BytesIO(summary)))
            records = list(StreamReader(exact, skip_magic=True).records)
        except BROKEN as error:
            self.note(f"{file}: its index is damaged ({_reason(error)}); read without it")
            return None
        return {c.topic: k for c, k in _typed(records)} or None

    def _channels(self, file: Path) -> Iterator[tuple[Channel, str]]:
        for record, kind in self._records(file):
            if isinstance(record, Channel):
                yield record, kind

    def _read(self, file: Path, topics: Collection[str] | None) -> Iterator[Raw]:
        if _magic(file) == SQLITE_MAGIC:
            yield from self._read_sqlite(file, topics)
            return
        channels: dict[int, tuple[Channel, str]] = {}
        for record, kind in self._records(file):
            if isinstance(record, Channel):
                channels[record.id] = record, kind
            elif record.channel_id not in channels:
                self.note(f"{file}: messages of a channel that is not described were left out")
            else:
                channel, kind = channels[record.channel_id]
                if topics is None or channel.topic in topics:
                    yield Raw(channel.topic, kind, record.log_time, record.data)

    def _records(self, file: Path) -> Iterator[tuple[Channel | Message, str]]:
        """Channels with their message type, and messages, out of one MCAP file."""
        schemas: dict[int, Schema] = {}
        with file.open("rb") as plain:
            stream: IO[bytes] = plain
            if _magic(file) == ZSTD_MAGIC:
                stream = zstandard.ZstdDecompressor().stream_reader(plain)
            for record in self._flat(file, _Exact(stream)):
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    yield record, self._kind(file, record, schemas)
                elif isinstance(record, Message):
                    yield record, ""

    def _kind(self, file: Path, channel: Channel, schemas: dict[int, Schema]) -> str:
        if channel.message_encoding != "cdr":
            return channel.message_encoding or "unknown"
        if channel.schema_id not in schemas:
            self.note(f"{file}: {channel.topic} has no schema")
            return "unknown"
        return schemas[channel.schema_id].name

    def _flat(self, file: Path, stream: _Exact) -> Iterator[Any]:
        """Records of an MCAP stream with chunks opened; stops, with a note, where it is broken."""
        exact = cast("IO[bytes]", stream)  # all that it needs is read()
        reader = StreamReader(exact, emit_chunks=True, record_size_limit=MAX_CHUNK)
        records = reader.records
        while True:
            try:
                record = next(records)
            except StopIteration:
                return
            except EndOfFile:
                self.note(f"{file}: ends in the middle; read up to there")
                return
            except BROKEN as error:
                self.note(
                    f"{file}: damaged at byte {stream.count} ({_reason(error)}); read up to there"
                )
                return
            if isinstance(record, Footer):
                return
            if not isinstance(record, Chunk):
                yield record
                continue
            try:
                inner = _unpack(record)
            except BROKEN as error:
                self.note(
                    f"{file}: a chunk of {record.uncompressed_size} bytes before byte "
                    f"{stream.count} is damaged ({_reason(error)}); left out"
                )
                continue
            yield from inner

    def _read_sqlite(self, file: Path, topics: Collection[str] | None) -> Iterator[Raw]:
        rows = _sqlite(
            file,
            "SELECT name, type, timestamp, data FROM messages JOIN topics "
            "ON topics.id = messages.topic_id ORDER BY timestamp, messages.id",
            *(str, str, int, bytes),
        )
        try:
            for row in rows:
                if topics is None or row[0] in topics:
                    yield Raw(*row)
        except (sqlite3.Error, ValueError) as error:
            self.note(f"{file}: damaged ({_reason(error)}); read up to there")


class _Exact:
    """A stream that gives all the bytes asked for or says that it ended."""

    def __init__(self, stream: IO[bytes]) -> None:
        self.stream, self.count = stream, 0

    def read(self, size: int) -> bytes:
        data = self.stream.read(size)
        self.count += len(data)
        if len(data) < size:
            raise EndOfFile
        return data


def _magic(file: Path) -> bytes:
    """Which of the formats that we read a file has.

    Raises:
        RecordingError: empty, or none of them.
    """
    with file.open("rb") as stream:
        start = stream.read(16)
    if file.name.endswith(".db3.zstd"):
        raise RecordingError(file, "an uncompressed SQLite file (zstd -d makes one)", "zstd")
    for magic in (MCAP_MAGIC, ZSTD_MAGIC, SQLITE_MAGIC):
        if start.startswith(magic):
            return magic
    if not start:
        got = "an empty file"
    elif start.startswith(ROS1_MAGIC):
        got = "a ROS 1 bag (rosbags-convert turns it into one)"
    else:
        got = f"a file that begins with {start[:8]!r}"
    raise RecordingError(file, "a ROS 2 recording (MCAP or SQLite)", got)


def _read_metadata(file: Path) -> dict[str, Any]:
    """The bag information in metadata.yaml; empty when it is unusable, the files say enough."""
    try:
        if file.stat().st_size > MAX_METADATA:
            return {}
        data = yaml.safe_load(file.read_text(encoding="utf-8"))
        info = data["rosbag2_bagfile_information"]
    except (yaml.YAMLError, ValueError, RecursionError, TypeError, KeyError):
        return {}
    return info if isinstance(info, dict) else {}


def _natural(name: str) -> list[Any]:
    """Sort key with bag_10 behind bag_9."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def _typed(records: list[Any]) -> Iterator[tuple[Channel, str]]:
    schemas = {r.id: r for r in records if isinstance(r, Schema)}
    for record in records:
        if isinstance(record, Channel):
            known = record.message_encoding == "cdr" and record.schema_id in schemas
            yield record, schemas[record.schema_id].name if known else record.message_encoding


def _unpack(chunk: Chunk) -> list[Any]:
    data = _decompress(chunk.compression, chunk.data, chunk.uncompressed_size)
    if len(data) != chunk.uncompressed_size:
        raise ValueError(f"{len(data)} bytes instead of {chunk.uncompressed_size}")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("its checksum is wrong")
    return breakup_chunk(
        Chunk("", data, chunk.message_end_time, chunk.message_start_time, 0, len(data))
    )


def _decompress(method: str, data: bytes, size: int) -> bytes:
    """At most MAX_CHUNK bytes, whatever the data claim."""
    if size > MAX_CHUNK:
        raise ValueError(f"it claims {size} bytes")
    if method == "":
        return data
    if method == "zstd":
        claimed = zstandard.frame_content_size(data)
        if claimed > MAX_CHUNK:
            raise ValueError(f"it claims {claimed} bytes")
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    if method == "lz4":
        return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    raise ValueError(f"compression {method!r} is unknown")


def _sqlite(file: Path, query: str, *types: type) -> Iterator[tuple[Any, ...]]:
    """Rows of a query; ValueError for a value of another type, which SQLite would let pass."""
    uri = f"{file.resolve().as_uri()}?mode=ro&immutable=1"
    with contextlib.closing(sqlite3.connect(uri, uri=True)) as database:
        for row in database.execute(query):
            if not all(map(isinstance, row, types)):
                raise ValueError(f"values {quoted(row)} in the database")
            yield row


def _reason(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
