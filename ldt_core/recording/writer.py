"""Writing a recording as it happens: a rosbag2 folder with one MCAP file.

Each message is in the kernel's hands at most `FLUSH_PERIOD` after it was written, also when no
further one follows, so that a killed process loses no more than that. Power failure is not covered:
nothing is forced onto the medium.
"""

from __future__ import annotations

import contextlib
import errno
import threading
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import msgs_config
from ldt_core.errors import LdtError, RecordingError, did_you_mean
from ldt_core.recording import run_settings
from ldt_core.recording.codec import Record, encode_cdr
from ldt_core.recording.messages import (
    declaration,
    offered_qos_text,
    schema,
    serialize,
)
from ldt_core.recording.metadata import Channel, Span, information, write_metadata
from ldt_core.recording.storage import PROFILE

FLUSH_PERIOD = 0.25  # s; half of the 0.5 s that may be lost, to leave time for the flush itself
LAST_NS = 2**63 - 1  # rosbag2 counts nanoseconds in 64 bits, to the year 2262


class BagWriter:
    """A recording that is being written; use it in a `with` statement.

    Args:
        path: folder to make; must not exist.
        machine: name of the machine, for the statuses and for the folder's metadata.
        namespace: put before relative topics ("machine_1").
        topics: topics to declare at once, so that a recording cut short names them.
        settings: parameters of the run, by name, for the folder's metadata.

    Raises:
        RecordingError: the folder exists or cannot be made.
    """

    def __init__(
        self,
        path: str | Path,
        machine: str = "",
        namespace: str = "",
        topics: tuple[str, ...] = (),
        settings: Mapping[str, Any] | None = None,
    ) -> None:
        from mcap.writer import CompressionType, IndexType, Writer

        self.path = Path(path)
        self.machine = machine
        self._custom = {
            "machine": machine,
            run_settings.KEY: run_settings.settings_text(settings) if settings else "",
        }
        self.prefix = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
        self._file_name = f"{self.path.resolve().name}_0.mcap"
        self._channels: dict[str, Channel] = {}
        self._schemas: dict[str, int] = {}
        self._span = Span()
        self._failure: LdtError | None = None
        self._dirty = False
        self._lock = threading.Lock()  # the file belongs to callers and the flusher in turn
        self._closed = threading.Event()
        declared = [self._declare(self._absolute(t), self._kind(t)) for t in topics]
        self._stream = self._make_folder()
        self._mcap = Writer(
            self._stream,
            compression=CompressionType.ZSTD,
            index_types=IndexType.CHUNK | IndexType.MESSAGE | IndexType.METADATA,
        )
        try:
            self._mcap.start(profile=PROFILE, library="ldt")
            for channel in declared:
                self._register(channel)
            write_metadata(self.path, self._information())
        except OSError as error:
            self._stream.close()
            raise self._fail(error) from None
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
        if not 0 <= time_s * 1e9 < LAST_NS:
            raise RecordingError(
                f"{self.path}, {topic}, time", "seconds since the epoch, 0 to 9.2e9", time_s
            )
        ours = isinstance(record, Record)
        data = encode_cdr(record, self.machine, time_s) if ours else serialize(record)
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
            channel = self._channels.get(topic) or self._declare(topic, kind)
            if channel.kind != kind:
                raise RecordingError(f"{self.path}, {topic}", channel.kind, kind)
            try:
                if not channel.number:
                    self._register(channel)
                self._mcap.add_message(channel.number, time_ns, data, time_ns, channel.count)
            except OSError as error:
                raise self._fail(error) from None
            channel.count += 1
            self._span.add(time_ns)
            self._dirty = True

    def flush(self) -> None:
        """Hand all that was written to the operating system.

        Raises:
            LdtError: the disk is full or failed.
        """
        with self._lock:
            if self._failure is not None:
                raise self._failure
            if self._dirty and not self._closed.is_set():
                try:
                    self._mcap.flush()
                except OSError as error:
                    raise self._fail(error) from None
                self._dirty = False

    def close(self) -> None:
        """Write the index and the final `metadata.yaml`; a second call does nothing.

        Raises:
            LdtError: the disk is or was full or failed: the recording is incomplete.
        """
        with self._lock:
            if self._closed.is_set():
                return
            self._closed.set()
            information = self._information()
            try:
                if self._failure is None:
                    self._mcap.add_metadata("rosbag2", {"serialized_metadata": information})
                    self._mcap.finish()
                    self._stream.flush()
            except OSError as error:
                self._fail(error)
            finally:
                # The buffer of a failed stream cannot be written; closing would try and fail again.
                with contextlib.suppress(OSError):
                    self._stream.close()
                with contextlib.suppress(OSError):
                    write_metadata(self.path, information)
        self._flusher.join()
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

    def _fail(self, error: Exception) -> LdtError:
        """Keep the one failure that all later calls report."""
        full = isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)
        reason = "the disk is full" if full else (getattr(error, "strerror", None) or str(error))
        written = sum(c.count for c in self._channels.values())
        self._failure = LdtError(
            f"{self.path}: {reason}; recording stopped after {written} messages, "
            "those already on disk stay readable"
        )
        return self._failure

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

    def _declare(self, topic: str, kind: str) -> Channel:
        schema(kind, f"{self.path}, {topic}")  # refuses what is not a standard type
        self._channels[topic] = Channel(topic, kind)
        return self._channels[topic]

    def _register(self, channel: Channel) -> None:
        text, digest = schema(channel.kind)
        if channel.kind not in self._schemas:
            number = self._mcap.register_schema(channel.kind, "ros2msg", text.encode())
            self._schemas[channel.kind] = number
        channel.number = self._mcap.register_channel(
            channel.topic,
            "cdr",
            self._schemas[channel.kind],
            {"offered_qos_profiles": offered_qos_text(channel.topic), "topic_type_hash": digest},
        )

    def _information(self) -> str:
        return information(self._channels.values(), self._span, self._file_name, self._custom)
