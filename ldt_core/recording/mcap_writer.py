"""One MCAP file that is being written, as stock tools want it: chunks, indexes, checksums."""

from __future__ import annotations

import contextlib
import errno
import os
from pathlib import Path

from mcap.records import Channel, Schema
from mcap.writer import CompressionType, IndexType, Writer

from ldt_core.recording.mcap_records import LIBRARY
from ldt_core.recording.messages import offered_qos_text, schema
from ldt_core.recording.metadata import METADATA, FileInformation
from ldt_core.recording.storage import PROFILE

VANISHED = "the file or its folder was deleted or renamed while it was written"
CUT = "somebody else cut the file short while it was written"


def describe_channel(topic: str, kind: str) -> tuple[Channel, Schema]:
    """A topic of a standard message type, with the declared quality of service, not numbered yet.

    Raises:
        RecordingError: the type is not a standard one.
    """
    text, digest = schema(kind)
    about = {"offered_qos_profiles": offered_qos_text(topic), "topic_type_hash": digest}
    described = Schema(id=0, name=kind, encoding="ros2msg", data=text.encode())
    return Channel(0, topic, "cdr", about, 0), described


class McapWriter:
    """A new file; whoever makes it calls `finish` or `abandon`.

    Args:
        file: must not exist.
        library: what the file names as its writer.

    Raises:
        OSError: it exists or cannot be made, as every method may when the disk fails.
    """

    def __init__(self, file: Path, library: str = LIBRARY) -> None:
        self.file = file
        #: What it holds so far.
        self.facts = FileInformation(file.name)
        #: Chunks written; each is held in memory as an entry of the index.
        self.chunks = 0
        #: Bytes written, without what is still collected for the next chunk.
        self.size = 0
        self._flushed = 0  # bytes in the operating system's hands at least
        self._stream = file.open("xb")
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._writer = Writer(
            self._stream,
            compression=CompressionType.ZSTD,
            index_types=IndexType.CHUNK | IndexType.MESSAGE | IndexType.METADATA,
            enable_data_crcs=True,
        )
        try:
            self._writer.start(profile=PROFILE, library=library)
            self._stream.flush()  # a process killed now leaves a file that can be read
        except OSError:
            self.abandon()
            with contextlib.suppress(OSError):
                file.unlink()  # it holds nothing
            raise
        self.size = self._flushed = self._stream.tell()

    def register(self, channel: Channel, described: Schema | None) -> int:
        """Describe a channel; its number in the file, from 1 in the order of these calls."""
        number = 0
        if described is not None and described.encoding:
            key = described.name, described.encoding, described.data
            if key not in self._schemas:
                self._schemas[key] = self._writer.register_schema(*key)
            number = self._schemas[key]
        about = channel.topic, channel.message_encoding, number, dict(channel.metadata)
        return int(self._writer.register_channel(*about))

    def add(
        self,
        channel: int,
        data: bytes,
        time_ns: int,
        sequence: int,
        published_ns: int | None = None,
    ) -> None:
        """Write a message; it is in the file after the next `flush` at the latest."""
        self._require_whole()
        sent = time_ns if published_ns is None else published_ns
        self._writer.add_message(channel, time_ns, data, sent, sequence)
        self.facts = self.facts.with_message(time_ns)
        self._measure()

    def flush(self) -> None:
        """Hand all that was written to the operating system."""
        self._writer.flush()
        self._flushed = self._stream.tell()
        self._measure()

    def require_place(self) -> None:
        """Refuse to go on where the file is no longer there: it would vanish with the last message.

        Raises:
            FileNotFoundError: it, or its folder, was deleted, renamed or replaced.
            PermissionError: its folder may not be looked into any more.
            OSError: it was cut short.
        """
        own = self._require_whole()
        try:
            there = self.file.stat()
        except PermissionError:  # it is there, behind a folder that was closed
            raise
        except OSError:
            there = None
        if there is None or (there.st_dev, there.st_ino) != (own.st_dev, own.st_ino):
            raise FileNotFoundError(errno.ENOENT, VANISHED)

    def _require_whole(self) -> os.stat_result:
        """What follows would stand behind a hole, in a file without a beginning."""
        own = os.fstat(self._stream.fileno())
        if own.st_size < self._flushed:
            raise OSError(errno.EIO, CUT)
        return own

    def descriptor(self) -> int:
        """A descriptor of the file that is the caller's to close."""
        return os.dup(self._stream.fileno())

    def finish(self, information: str) -> None:
        """Write the index, force all onto the medium and close.

        Args:
            information: the recording's, for whoever has this file alone.
        """
        self.require_place()
        self._writer.add_metadata("rosbag2", {"serialized_metadata": information})
        self._writer.finish()
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self._stream.close()

    def abandon(self) -> None:
        """Close, without an index; a second call, or one after `finish`, does nothing."""
        # The buffer of a failed stream cannot be written; closing would try and fail again.
        with contextlib.suppress(OSError):
            self._stream.close()

    def discard(self) -> None:
        """Close and remove it, of a recording in which nothing is: the folder too, if that is all.

        What cannot be removed stays.
        """
        self.abandon()
        with contextlib.suppress(OSError):
            self.file.unlink()
            self.file.with_name(METADATA).unlink()
            self.file.parent.rmdir()

    def _measure(self) -> None:
        size = self._stream.tell()
        if size > self.size:
            self.size, self.chunks = size, self.chunks + 1
