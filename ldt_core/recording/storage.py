"""The files of a recording: raw messages out of MCAP (also zstd-compressed) and SQLite.

MCAP is read as a stream, chunk by chunk, in bounded memory. A file without an end (its writer was
killed) or with broken chunks gives what is left of it, and `Storage.notes` says what is not.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import re
import sqlite3
from codecs import BOM_UTF8
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path, PurePath
from typing import Any, NamedTuple

from mcap.records import Channel, Schema

from ldt_core.base.bounded_file import nothing_there
from ldt_core.base.errors import RecordingError
from ldt_core.recording.mcap_reader import Described, TolerantMcapReader
from ldt_core.recording.mcap_records import (
    DAMAGE_ERRORS,
    MAX_CHUNK,
    MCAP_MAGIC,
    ZSTD_MAGIC,
    decompress,
    reason,
)
from ldt_core.recording.messages import quoted, schema
from ldt_core.recording.metadata import METADATA, listed_topics, read_metadata

#: Where recordings go that are not told where to.
RECORDINGS = Path("ldt_recordings")
PROFILE = "ros2"
SQLITE_MAGIC = b"SQLite format 3\x00"
#: Ending of a text that is no table → what it is, and which command takes it.
TEXTS = {
    ".yaml": "a YAML text (a machine file goes behind --machine)",
    ".json": "a JSON text (--with takes a diagnosis, --settings what ldt tune found)",
}
ROS1_MAGIC = b"#ROSBAG V"
LEAST_ALIKE_BYTES = 6  # bytes of MCAP's first 8 by which a file is taken for a damaged one


class RawMessage(NamedTuple):
    """One message as it is stored: CDR bytes, and when it was received [ns since the epoch]."""

    topic: str
    kind: str
    time_ns: int
    data: bytes


class Storage:
    """A recording's files in order.

    Args:
        path: rosbag2 folder, or a bare file of one.
        listed: take the topics from metadata.yaml, if it has any, without looking into the files,
            of which there may be a thousand.

    Raises:
        RecordingError: nothing there, empty, or no ROS 2 recording.
    """

    def __init__(self, path: str | Path, listed: bool = False) -> None:
        self.path = Path(path)
        self._notes: dict[str, None] = {}
        self.metadata: dict[str, Any] = {}
        #: Names of the files that metadata.yaml lists.
        self.listed: list[str] = []
        #: Files of the folder that hold nothing readable.
        self.unusable: list[Path] = []
        self.files = self._find_files()
        self.topics: dict[str, str] = {}
        if listed:
            entries = listed_topics(self.metadata).items()
            self.topics = {topic: entry["topic_metadata"]["type"] for topic, entry in entries}
        if not self.topics:
            for file in self.files:
                self._discover(file)

    @property
    def notes(self) -> list[str]:
        """What is damaged or missing, a sentence each; complete after all has been read."""
        return list(self._notes)

    def note(self, sentence: str) -> None:
        """Add to the notes, once."""
        self._notes[sentence] = None

    def messages(
        self, topics: Collection[str] | None = None, begin: tuple[int, int] = (0, 0)
    ) -> Iterator[RawMessage]:
        """Messages of the topics (of all when None), in the order in which they were recorded.

        Args:
            topics: absolute.
            begin: file and byte before which nothing is read; reading begins with the next chunk.
        """
        per_message = str(self.metadata.get("compression_mode", "")).lower() == "message"
        for index, file in enumerate(self.files[begin[0] :]):
            for raw in self.read(file, topics, 0 if index else begin[1]):
                yield self._unzipped(raw) if per_message else raw

    def picked(self, topics: Collection[str]) -> Iterator[RawMessage]:
        """Messages of topics that are rare, without reading all of the files; damage is no matter.

        Of files without an index as `messages`.
        """
        for file in self.files:
            yield from self.read(file, topics, picked=True)

    def counts(self, topics: Collection[str] | None = None) -> Counter[str]:
        """Messages of each topic, of all when None, by the files' indexes; without one, by all."""
        found: Counter[str] = Counter()
        for file in self.files:
            about = self.mcap(file).summary(places=False) if is_mcap(file) else None
            if about is None or about.statistics is None:
                found.update(raw.topic for raw in self.read(file, topics))
                continue
            counts = about.statistics.channel_message_counts
            for number, (channel, _) in about.channels.items():
                found[channel.topic] += counts.get(number, 0)
        return found

    def last(self, topics: Collection[str], most: int) -> list[RawMessage]:
        """The last messages of topics that are rare, so many at least where there are as many."""
        found: list[RawMessage] = []
        for file in reversed(self.files):
            if len(found) < most:
                found = [*self.read(file, topics, picked=True), *found]
        return found

    def before_end(self, back: int) -> tuple[int, int]:
        """File and byte so many bytes before the end, for `messages`."""
        for index, file in reversed(list(enumerate(self.files))):
            size = file.stat().st_size
            if back < size:
                return index, size - back
            back -= size
        return 0, 0

    def _unzipped(self, raw: RawMessage) -> RawMessage:
        try:
            return raw._replace(data=decompress("zstd", raw.data, MAX_CHUNK))
        except DAMAGE_ERRORS as error:
            raise RecordingError(
                f"{self.path}, {raw.topic}", "messages compressed with zstd", reason(error)
            ) from None

    def _find_files(self) -> list[Path]:
        path = self.path
        wanted = "a recording (a rosbag2 folder or an .mcap file)"
        try:
            if not path.exists():
                raise RecordingError(path, wanted, nothing_there(path))
            if path.is_dir():
                return self._files_of_folder()
            if not path.is_file():  # a pipe into which nobody writes would never be read
                raise RecordingError(path, wanted, "a pipe or a device")
            _magic(path)
        except OSError as error:
            raise RecordingError(path, "a readable recording", error.strerror or error) from None
        return [path]

    def _files_of_folder(self) -> list[Path]:
        if (self.path / METADATA).is_file():
            self.metadata = read_metadata(self.path / METADATA)
            names = self.metadata.get("relative_file_paths")
            if not isinstance(names, list):
                self.note(f"{self.path}: {METADATA} is cut off or damaged; the files tell the rest")
                names = []
            self.listed = list(dict.fromkeys(PurePath(n).name for n in names if type(n) is str))
        found = [
            f.name for f in self.path.iterdir() if re.search(r"\.(mcap|db3)(\.zstd)?$", f.name)
        ]
        listed = self.listed
        # A recorder that was killed lists the files it began with, or none at all.
        files = listed + sorted((f for f in found if f not in listed), key=_natural)
        present = [self.path / f for f in files if (self.path / f).is_file()]
        if not present:
            got = "none of them" if listed else "no such file"
            expected = ", ".join(listed) or ".mcap files, as in a rosbag2 folder"
            raise RecordingError(self.path, expected, got)
        if listed and not any(path.name in listed for path in present):
            told = f"{METADATA} is of another recording: it lists {listed[0]}"
            self.note(f"{self.path}: {told}, and not {present[0].name}")
            return self._usable(present)
        for name in files:
            if not (self.path / name).is_file():
                self.note(f"{self.path}: {METADATA} lists {name}, which is missing")
        return self._usable(present)

    def _usable(self, files: list[Path]) -> list[Path]:
        """Without those that hold nothing: a writer that was killed at once leaves such a one."""
        found, refused = [], None
        for file in files:
            try:
                self._refuse_link(file)
                _magic(file)
                found.append(file)
            except RecordingError as error:
                refused = refused or error
                self.unusable.append(file)
                self.note(f"{file}: {error.got}; left out")
        if refused and not found:
            raise refused
        return found

    def _refuse_link(self, file: Path) -> None:
        """A recording that was sent must not bring other files of this machine into a report."""
        if file.resolve().parent != self.path.resolve():
            expected = "a file of the recording's own folder"
            raise RecordingError(file, expected, "a link to one of another folder")

    def _discover(self, file: Path) -> None:
        """Fill `topics` from one file."""
        if _magic(file) == SQLITE_MAGIC:
            try:
                found = list(_sqlite(file, "SELECT name, type FROM topics", str, str))
            except (sqlite3.Error, ValueError) as error:
                raise RecordingError(file, "a rosbag2 SQLite file", reason(error)) from None
        else:
            described = self.mcap(file).channels().values()
            found = [(c.topic, self._kind(file, c, s)) for c, s in described]
        for topic, kind in found:
            known = self.topics.setdefault(topic, kind)
            if known != kind:
                raise RecordingError(f"{self.path}, {topic}", f"one message type, {known}", kind)

    def mcap(self, file: Path) -> TolerantMcapReader:
        """One of the MCAP files, which notes here what is wrong with it."""
        return TolerantMcapReader(file, self.note, lambda: self.declared)

    @functools.cached_property
    def declared(self) -> Described:
        """Channels by their number in a file of LDT's, as metadata.yaml lists their topics."""
        found: Described = {}
        for number, (topic, entry) in enumerate(listed_topics(self.metadata).items(), start=1):
            kind = entry["topic_metadata"]["type"]
            with contextlib.suppress(RecordingError):
                text = schema(kind)[0].encode()
                found[number] = (
                    Channel(number, topic, "cdr", {}, number),
                    Schema(data=text, encoding="ros2msg", id=number, name=kind),
                )
        return found

    def read(
        self,
        file: Path,
        topics: Collection[str] | None = None,
        begin: int = 0,
        picked: bool = False,
    ) -> Iterator[RawMessage]:
        """Messages of one file.

        Args:
            file: of the recording.
            topics: absolute; None for all.
            begin: byte of an MCAP file before which nothing is read, a chunk's first one.
            picked: of the topics, by the index where there is one.
        """
        if _magic(file) == SQLITE_MAGIC:
            yield from self._read_sqlite(file, topics)
            return
        mcap = self.mcap(file)
        found = mcap.messages_of(topics or ()) if picked else mcap.messages(begin, topics)
        kinds: dict[int, tuple[Channel, str]] = {}
        for channel, described, message in found:
            known, kind = kinds.get(channel.id, (None, ""))
            if known is not channel:
                kind = self._kind(file, channel, described)
                kinds[channel.id] = channel, kind
            yield RawMessage(channel.topic, kind, message.log_time, message.data)

    def _kind(self, file: Path, channel: Channel, described: Schema | None) -> str:
        if channel.message_encoding != "cdr":
            return channel.message_encoding or "unknown"
        if described is None:
            self.note(f"{file}: {channel.topic} has no schema")
            return "unknown"
        return described.name

    def _read_sqlite(self, file: Path, topics: Collection[str] | None) -> Iterator[RawMessage]:
        rows = _sqlite(
            file,
            "SELECT name, type, timestamp, data FROM messages JOIN topics "
            "ON topics.id = messages.topic_id ORDER BY timestamp, messages.id",
            *(str, str, int, bytes),
        )
        try:
            for row in rows:
                if topics is None or row[0] in topics:
                    yield RawMessage(*row)
        except (sqlite3.Error, ValueError) as error:
            self.note(f"{file}: damaged ({reason(error)}); read up to there")


def is_mcap(file: Path) -> bool:
    """Whether it is an MCAP file that is not compressed as a whole.

    Raises:
        RecordingError: empty, or of no format that we read.
    """
    return _magic(file) == MCAP_MAGIC


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
    if sum(a == b for a, b in zip(start, MCAP_MAGIC, strict=False)) >= LEAST_ALIKE_BYTES:
        return MCAP_MAGIC
    if not start:
        got = "an empty file"
    elif start.startswith(ROS1_MAGIC):
        got = "a ROS 1 bag (rosbags-convert turns it into one)"
    elif _is_text(start):
        got = TEXTS.get(file.suffix, "a text (ldt info says how to import a table)")
    else:
        got = f"a file that begins with {start[:8]!r}"
    raise RecordingError(file, "a ROS 2 recording (MCAP or SQLite)", got)


def _is_text(start: bytes) -> bool:
    """Whether a file's first bytes are of a text; a byte-order mark may be before it."""
    bare = b"".join(start.removeprefix(BOM_UTF8).split())
    return bare.isascii() and bare.decode("ascii").isprintable()


def _natural(name: str) -> list[Any]:
    """Sort key with bag_10 behind bag_9."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def _sqlite(file: Path, query: str, *types: type) -> Iterator[tuple[Any, ...]]:
    """Rows of a query; ValueError for a value of another type, which SQLite would let pass."""
    uri = f"{file.resolve().as_uri()}?mode=ro&immutable=1"
    with contextlib.closing(sqlite3.connect(uri, uri=True)) as database:
        for row in database.execute(query):
            if not all(map(isinstance, row, types)):
                raise ValueError(f"values {quoted(row)} in the database")
            yield row


def free_name(file: Path) -> Path:
    """This name, or with a number behind it the first that no file has."""
    numbered = (file.with_name(f"{file.name}.{count}") for count in itertools.count(2))
    return next(name for name in itertools.chain([file], numbered) if not name.exists())
