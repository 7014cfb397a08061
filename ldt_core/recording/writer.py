"""Writing a recording as it happens: a rosbag2 folder with MCAP files, a new one at a stated size.

Each message is in the kernel's hands at most `FLUSH_PERIOD` after it was written, also when no
further one follows, so that a killed process loses no more than that. A file that is complete and
the `metadata.yaml` that lists it are forced onto the medium; so is what was written to the present
file, each `SYNC_PERIOD`.

`metadata.yaml` is right about all files but the one that is being written. It holds the settings of
the run, and so does each complete file at its end. Messages stand in the file of their time alone:
models of before are in the files of before.
"""

from __future__ import annotations

import contextlib
import errno
import os
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import msgs_config
from ldt_core.base.errors import LdtError, RecordingError, did_you_mean
from ldt_core.base.sentences import counted
from ldt_core.recording import run_settings
from ldt_core.recording.append import RecordedContents, resume_contents
from ldt_core.recording.codec import Record, encode_cdr
from ldt_core.recording.duplicate_filter import DuplicateFilter
from ldt_core.recording.experiment_numbers import ExperimentNumbers, numbers_text
from ldt_core.recording.lock import FolderLock
from ldt_core.recording.mcap_writer import CUT, VANISHED, McapWriter, describe_channel
from ldt_core.recording.message_subject import number_of
from ldt_core.recording.messages import declaration, schema, serialize
from ldt_core.recording.metadata import TopicInformation, bag_information, text_of, write_metadata
from ldt_core.recording.node_status import HEALTH_TOPIC
from ldt_core.recording.repair import RECORDED

FLUSH_PERIOD = 0.25  # s; half of the 0.5 s that may be lost, to leave time for the flush itself
SYNC_PERIOD = 5.0  # s; what a power failure may cost, beside the time that the medium takes
LAST_NS = 2**63 - 1  # rosbag2 counts nanoseconds in 64 bits, to the year 2262
KEY = "key"  # of a recording's custom data
MEGABYTE = 1_000_000  # bytes
#: Why nothing more is written, where the system's words would not say it.
REASONS = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT), "the disk is full"),
    errno.EBADF: "its file was closed, as by a part of your own",
}
PATIENCE = 1.0  # s; for a writer that was killed to be gone, or for somebody who only looks
MOST_CHUNKS = 20_000  # of a file, whose index is held in memory until it ends: about 1 kB each


class BagWriter:
    """A recording that is being written; use it in a `with` statement.

    Where that ends by an error before anything was written, nothing stays of a new recording.

    Args:
        path: folder to make; must not exist unless `resume` is set.
        machine: name of the machine, for the statuses and for the folder's metadata.
        namespace: put before relative topics ("machine_1").
        topics: topics to declare at once, so that a recording cut short names them.
        settings: parameters of the run, by name, for the folder's metadata.
        split_size: a new file is begun when the present one exceeds so much [MB]; 0 never for its
            size; None as declared in `parameters.yaml`.
        resume: go on with a recording whose writer ended or was killed, in a new file of its
            folder; what the killed one left is mended first. Machine, settings and topics must be
            those recorded; settings that are not given are taken from there. A folder that does
            not exist is made.
        once: leave out a message that was written before, byte for byte, and after `resume` one
            about an experiment, of the same time, that the end of the recording has on this topic:
            somebody was started again, and says once more what may not have been heard.
        key: of the run, for the folder's metadata (`ldt_core.restart.run_key`).

    Raises:
        RecordingError: the folder exists or cannot be made; somebody is writing to it; or it is no
            recording of this machine with these settings.
        LdtError: what a killed writer left cannot be mended.
    """

    def __init__(
        self,
        path: str | Path,
        machine: str = "",
        namespace: str = "",
        topics: tuple[str, ...] = (),
        settings: Mapping[str, Any] | None = None,
        split_size: float | None = None,
        resume: bool = False,
        once: bool = False,
        key: str = "",
    ) -> None:
        self.path = Path(path)
        self.machine = machine
        custom = {
            "machine": machine,
            run_settings.KEY: run_settings.settings_text(settings) if settings else "",
            **({KEY: key} if key else {}),
        }
        self._held = RecordedContents(custom, stem=os.path.basename(os.path.realpath(self.path)))
        self._repeats = DuplicateFilter() if once else None
        if split_size is None:
            split_size = float(msgs_config.parameters()["split_size"]["default"])
        self._most_bytes = split_size * MEGABYTE
        self.prefix = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
        #: What `resume` found damaged, and mended, a sentence each.
        self.mended: list[str] = []
        self._channels: dict[str, int] = {}  # topic → its number in the present file
        #: Why nothing more is written, once the disk was full or failed.
        self.failure: LdtError | None = None
        self._dirty = False
        self._unlisted = False  # a topic that metadata.yaml does not name yet
        self._lock = threading.Lock()  # the file belongs to callers and the flusher in turn
        self._closed = threading.Event()
        wanted = [self._declare(self._absolute(t), self._kind(t)) for t in topics]
        self._made = self._make_folder(resume)
        self._owner = FolderLock(self._folder, PATIENCE if resume else 0.0)
        self._threads = [
            threading.Thread(target=self._flush_regularly, name="bag", daemon=True),
            threading.Thread(target=self._sync_regularly, name="bag_sync", daemon=True),
        ]
        try:
            if resume:
                self._go_on(wanted)
            self._begin()
            for thread in self._threads:
                thread.start()
        except BaseException:
            self._owner.release()
            if self._made:
                with contextlib.suppress(OSError):
                    self.path.rmdir()  # nothing is in it
            raise

    @property
    def counts(self) -> dict[str, int]:
        """Absolute topic → messages written, those before `resume` included."""
        return {name: topic.count for name, topic in self._held.topics.items()}

    def recorded(self, topic: str) -> ExperimentNumbers:
        """The experiments of which a message of this topic is recorded; do not change them.

        Args:
            topic: relative or absolute; one of those whose messages are about an experiment.
        """
        return self._held.numbers.get(self._absolute(topic), ExperimentNumbers())

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

    def write_raw(self, topic: str, kind: str, data: bytes, time_ns: int) -> bool:
        """Write a message that is serialised already; whether it was not left out.

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
            if self.failure is not None:
                raise self.failure
            if self._closed.is_set():
                raise LdtError(f"{self.path}: the recording is closed")
            known = self._held.topics.get(topic) or self._declare(topic, kind)
            if known.kind != kind:
                raise RecordingError(f"{self.path}, {topic}", known.kind, kind)
            if topic != HEALTH_TOPIC and self._repeats and self._repeats.seen(topic, kind, data):
                return False
            if self._part.chunks >= MOST_CHUNKS or 0 < self._most_bytes < self._part.size:
                self._split()
            try:
                if topic not in self._channels:
                    self._channels[topic] = self._part.register(*describe_channel(topic, kind))
                    self._unlisted = True
                self._part.add(self._channels[topic], data, time_ns, known.count)
            except OSError as error:
                raise self._fail(error) from None
            known.count += 1
            self._dirty = True
            number = number_of(topic, kind, data)
            if number is not None:
                self._held.numbers[topic].add(number)
            return True

    def flush(self) -> None:
        """Hand all that was written to the operating system.

        Raises:
            LdtError: the disk is full or failed.
        """
        with self._lock:
            if self.failure is not None:
                raise self.failure
            if not self._closed.is_set():
                try:
                    self._part.require_place()
                except OSError as error:
                    raise self._fail(error) from None
            if self._dirty and not self._closed.is_set():
                try:
                    self._part.flush()
                    if self._unlisted:  # a reader needs it where a file is damaged
                        self._write_metadata()
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
            try:
                if self.failure is None:
                    self._complete()
            except OSError as error:
                self._fail(error)
            finally:
                self._part.abandon()
                if self.failure is not None:
                    with contextlib.suppress(OSError):
                        self._write_metadata()
                self._owner.release()
        for thread in self._threads:
            thread.join()
        if self.failure is not None:
            raise self.failure

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: object, error: BaseException | None, *_: object) -> None:
        try:
            self.close()
        except LdtError:
            if error is None:
                raise
        if error is not None and self._made and not any(self.counts.values()):
            self._part.discard()

    def _make_folder(self, resume: bool) -> bool:
        """Whether it was not there before."""
        try:
            str(self.path).encode()
        except UnicodeEncodeError:  # metadata.yaml is UTF-8, and names the files
            raise RecordingError(self.path, "a name in UTF-8", "other bytes") from None
        made = not self.path.exists()
        try:
            # Code of the user's may go into another folder meanwhile.
            self._folder = self.path.absolute()
            self._folder.mkdir(parents=True, exist_ok=resume)
        except FileExistsError:
            expected = "a folder" if resume else "a folder that does not exist yet"
            raise RecordingError(
                self.path, expected, "a file" if resume else "an existing one"
            ) from None
        except OSError as error:
            raise self._refused(error) from None
        return made

    def _begin(self) -> None:
        """Make the first file that this writer fills, and list it."""
        try:
            self._part = self._new_file()
            try:
                self._write_metadata()
            except OSError:
                self._part.abandon()
                self._part.file.unlink()
                raise
        except OSError as error:
            raise self._refused(error) from None

    def _go_on(self, wanted: list[TopicInformation]) -> None:
        """Take over what is recorded."""
        self._held = resume_contents(self.path, self._held.custom, wanted)
        self.mended = self._held.notes
        for topic in wanted:
            self._held.topics.setdefault(topic.name, topic)
        self._held.stem = self._held.stem or os.path.basename(os.path.realpath(self.path))
        if self._repeats is not None and self._held.files:
            self._repeats = DuplicateFilter.of(self._folder)

    def _new_file(self) -> McapWriter:
        """Begin one, with all topics that are known so far."""
        part = McapWriter(self._folder / f"{self._held.stem}_{self._held.index}.mcap")
        self._held.index += 1
        self._channels = {
            name: part.register(*describe_channel(name, topic.kind))
            for name, topic in self._held.topics.items()
        }
        self._held.custom[RECORDED] = numbers_text(self._held.numbers, len(self._held.files))
        return part

    def _split(self) -> None:
        """Complete the present file and begin the next."""
        try:
            self._part.finish(text_of(self._information()))
            self._held.files.append(self._part.facts)
            self._part = self._new_file()
            self._write_metadata()
        except OSError as error:
            self._part.abandon()
            raise self._fail(error) from None

    def _refused(self, error: OSError) -> RecordingError:
        return RecordingError(self.path, "a place to write a recording", error.strerror or error)

    def _fail(self, error: Exception) -> LdtError:
        """Keep the one failure that all later calls report."""
        told = getattr(error, "strerror", None) or str(error)
        reason = REASONS.get(getattr(error, "errno", None) or 0, told)
        written = sum(topic.count for topic in self._held.topics.values())
        kept = "those already on disk stay readable"
        left = {VANISHED: "which went with it", CUT: "less what was cut off"}.get(reason, kept)
        self.failure = LdtError(
            f"{self.path}: {reason}; recording stopped after {counted(written, 'message')}, {left}"
        )
        return self.failure

    def _flush_regularly(self) -> None:
        while not self._closed.wait(FLUSH_PERIOD):
            with contextlib.suppress(LdtError):  # the next write or close reports it
                self.flush()

    def _sync_regularly(self) -> None:
        """Force the present file onto the medium, while others write to it."""
        while not self._closed.wait(SYNC_PERIOD):
            with self._lock:
                if self._closed.is_set() or self.failure is not None:
                    return
                descriptor = self._part.descriptor()
            try:
                os.fdatasync(descriptor)
            except OSError as error:  # the next write or close reports it
                with self._lock:
                    self._fail(error)
            finally:
                os.close(descriptor)

    def _absolute(self, topic: str) -> str:
        return topic if topic.startswith("/") else f"{self.prefix}/{topic}"

    def _kind(self, topic: str) -> str:
        declared = declaration(topic)
        if declared is None:
            raise RecordingError(
                f"{self.path}, topic", did_you_mean(topic, msgs_config.topics()), topic
            )
        return declared["type"]

    def _declare(self, name: str, kind: str) -> TopicInformation:
        schema(kind, f"{self.path}, {name}")  # refuses what is not a standard type
        self._held.topics[name] = TopicInformation(name, kind)
        return self._held.topics[name]

    def _information(self) -> dict[str, Any]:
        # After a split that failed the present file is among those that are complete.
        files = list(dict.fromkeys([*self._held.files, self._part.facts]))
        return bag_information(
            [t.entry() for t in self._held.topics.values()], files, self._held.custom
        )

    def _complete(self) -> None:
        """End the last file."""
        text = text_of(self._information())
        self._part.finish(text)
        write_metadata(self._folder, text)

    def _write_metadata(self) -> None:
        write_metadata(self._folder, text_of(self._information()))
        self._unlisted = False
