"""Writing a recording as it happens: a rosbag2 folder with one MCAP file.

Each message is in the kernel's hands at most `FLUSH_PERIOD` after it was written, also when no
further one follows, so that a killed process loses no more than that. Power failure is not covered:
nothing is forced onto the medium.
"""

from __future__ import annotations

import contextlib
import errno
import os
import threading
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import msgs_config
from ldt_core.errors import LdtError, RecordingError, did_you_mean
from ldt_core.recording.codec import Record, encode
from ldt_core.recording.messages import declaration, dump, offered_qos, schema, serialize
from ldt_core.recording.storage import METADATA, PROFILE

VERSION = 9  # of metadata.yaml, ROS 2 Jazzy's
FLUSH_PERIOD = 0.25  # s; half of the 0.5 s that may be lost, to leave time for the flush itself
LAST_NS = 2**63 - 1  # rosbag2 counts nanoseconds in 64 bits, to the year 2262


class _Channel:
    """A topic of the file: its type and how often it was written."""

    def __init__(self, number: int, kind: str) -> None:
        self.number, self.kind, self.count = number, kind, 0


class BagWriter:
    """A recording that is being written; use it in a `with` statement.

    Args:
        path: folder to make; must not exist.
        machine: name of the machine, for the statuses and for the folder's metadata.
        namespace: put before relative topics ("machine_1").
        topics: topics to declare at once, so that a recording cut short names them.

    Raises:
        RecordingError: the folder exists or cannot be made.
    """

    def __init__(
        self,
        path: str | Path,
        machine: str = "",
        namespace: str = "",
        topics: tuple[str, ...] = (),
    ) -> None:
        from mcap.writer import CompressionType, IndexType, Writer

        self.path = Path(path)
        self.machine = machine
        self.prefix = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
        self._file_name = f"{self.path.resolve().name}_0.mcap"
        self._channels: dict[str, _Channel] = {}
        self._schemas: dict[str, int] = {}
        self._first, self._last = LAST_NS, 0
        self._failure: LdtError | None = None
        self._dirty = False
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._stream = self._make_folder()
        self._mcap = Writer(
            self._stream,
            compression=CompressionType.ZSTD,
            index_types=IndexType.CHUNK | IndexType.MESSAGE | IndexType.METADATA,
        )
        with self._failing():
            self._mcap.start(profile=PROFILE, library="ldt")
            for topic in topics:
                self._channel(self._absolute(topic), self._kind(topic))
            self._write_metadata()
        self._flusher = threading.Thread(target=self._flush_regularly, name="bag", daemon=True)
        self._flusher.start()

    @property
    def counts(self) -> dict[str, int]:
        """Absolute topic → messages written."""
        return {topic: channel.count for topic, channel in self._channels.items()}

    def write(self, topic: str, record: Record | Any, time_s: float) -> None:
        """Write a record, or one of the messages of `ldt_core.recording.messages.standard`.

        Args:
            topic: relative (the namespace is added) or absolute, as declared in `topics.yaml`.
            record: what to write.
            time_s: when it was received [s since the epoch].

        Raises:
            RecordingError: an undeclared topic, or a time that a recording cannot hold.
            LdtError: the disk is full or failed; what was written stays readable.
        """
        message = record
        if isinstance(record, Record):
            message = encode(record, machine=self.machine, time=time_s)
        if not 0 <= time_s * 1e9 < LAST_NS:
            raise RecordingError(
                f"{self.path}, {topic}, time", "seconds since the epoch, 0 to 9.2e9", time_s
            )
        data = serialize(message)
        self.write_raw(self._absolute(topic), self._kind(topic), data, round(time_s * 1e9))

    def write_raw(self, topic: str, kind: str, data: bytes, time_ns: int) -> None:
        """Write a message that is serialised already.

        Args:
            topic: absolute.
            kind: message type, `package/msg/Name`, a standard one.
            data: CDR bytes.
            time_ns: when it was received [ns since the epoch].

        Raises:
            RecordingError: a type that is not a standard one, or another than before on this topic.
            LdtError: the disk is full or failed; what was written stays readable.
        """
        with self._lock:
            if self._failure is not None:
                raise self._failure
            if self._closed.is_set():
                raise LdtError(f"{self.path}: the recording is closed")
            with self._failing():
                channel = self._channels.get(topic) or self._channel(topic, kind)
                if channel.kind != kind:
                    raise RecordingError(f"{self.path}, {topic}", channel.kind, kind)
                self._mcap.add_message(channel.number, time_ns, data, time_ns, channel.count)
            channel.count += 1
            self._first, self._last = min(self._first, time_ns), max(self._last, time_ns)
            self._dirty = True

    def flush(self) -> None:
        """Hand all that was written to the operating system.

        Raises:
            LdtError: the disk is full or failed.
        """
        with self._lock, self._failing():
            if self._dirty and self._failure is None:
                self._mcap.flush()
                self._dirty = False

    def close(self) -> None:
        """Write the index and the final `metadata.yaml`; a second call does nothing.

        Raises:
            LdtError: the disk is or was full or failed: the recording is incomplete.
        """
        if self._closed.is_set():
            return
        self._closed.set()
        self._flusher.join()
        with self._lock:
            try:
                if self._failure is None:
                    with self._failing():
                        text = dump(self._information())
                        self._mcap.add_metadata("rosbag2", {"serialized_metadata": text})
                        self._mcap.finish()
                        self._stream.flush()
            finally:
                # The buffer of a failed stream cannot be written; closing would try and fail again.
                with contextlib.suppress(OSError):
                    self._stream.close()
                with contextlib.suppress(OSError):
                    self._write_metadata()
            if self._failure is not None:
                raise self._failure

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self.close()
        except LdtError:
            if error is None:
                raise

    def _make_folder(self) -> IO[bytes]:
        try:
            self.path.mkdir(parents=True)
            return (self.path / self._file_name).open("xb")
        except FileExistsError:
            raise RecordingError(
                self.path, "a folder that does not exist yet", "an existing one"
            ) from None
        except OSError as error:
            raise RecordingError(
                self.path, "a place to write a recording", error.strerror or error
            ) from None

    @contextlib.contextmanager
    def _failing(self):
        """Turn a failed write into the one failure that all later calls report."""
        try:
            yield
        except OSError as error:
            full = error.errno in (errno.ENOSPC, errno.EDQUOT)
            reason = "the disk is full" if full else (error.strerror or str(error))
            written = sum(c.count for c in self._channels.values())
            self._failure = LdtError(
                f"{self.path}: {reason}; recording stopped after {written} messages, "
                "those already on disk stay readable"
            )
            raise self._failure from None

    def _flush_regularly(self) -> None:
        while not self._closed.wait(FLUSH_PERIOD):
            with contextlib.suppress(LdtError):  # the next write or close reports it
                self.flush()

    def _absolute(self, topic: str) -> str:
        return topic if topic.startswith("/") else f"{self.prefix}/{topic}"

    def _kind(self, topic: str) -> str:
        declared = declaration(topic)
        if declared is None:
            raise RecordingError(
                f"{self.path}, topic", did_you_mean(topic, msgs_config.topics()), topic
            )
        return declared["type"]

    def _channel(self, topic: str, kind: str) -> _Channel:
        text, digest = schema(kind, f"{self.path}, {topic}")
        if kind not in self._schemas:
            self._schemas[kind] = self._mcap.register_schema(kind, "ros2msg", text.encode())
        number = self._mcap.register_channel(
            topic,
            "cdr",
            self._schemas[kind],
            {"offered_qos_profiles": dump(offered_qos(topic)), "topic_type_hash": digest},
        )
        self._channels[topic] = _Channel(number, kind)
        return self._channels[topic]

    def _information(self) -> dict[str, Any]:
        """The bag information of rosbag2, version 9."""
        total = sum(c.count for c in self._channels.values())
        span = {
            "duration": {"nanoseconds": self._last - self._first if total else 0},
            "starting_time": {"nanoseconds_since_epoch": self._first if total else 0},
            "message_count": total,
        }
        topics = [
            {
                "topic_metadata": {
                    "name": topic,
                    "type": channel.kind,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": offered_qos(topic),
                    "type_description_hash": schema(channel.kind)[1],
                },
                "message_count": channel.count,
            }
            for topic, channel in self._channels.items()
        ]
        return {
            "version": VERSION,
            "storage_identifier": "mcap",
            **span,
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self._file_name],
            "files": [{"path": self._file_name, **span}],
            "custom_data": {"machine": self.machine} if self.machine else None,
            "ros_distro": "jazzy",
        }

    def _write_metadata(self) -> None:
        text = dump({"rosbag2_bagfile_information": self._information()})
        new = self.path / f".{METADATA}.new"
        try:
            new.write_text(text, encoding="utf-8")
            os.replace(new, self.path / METADATA)  # a reader never meets half a file
        except OSError:
            new.unlink(missing_ok=True)
            raise
