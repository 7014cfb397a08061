"""Mending a recording: all messages that can be read go into sound files, the damaged ones stay.

A file that has no end, or in which anything is damaged, is written anew beside the old one with
every message before and after the damage, byte by byte as it was. Then it takes the old one's name,
and that one is kept as `NAME.damaged`. What is sound is not touched.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any

from mcap.reader import make_reader

from ldt_core.base.errors import LdtError, RecordingError
from ldt_core.base.sentences import counted, plain
from ldt_core.recording.experiment_numbers import parse_numbers
from ldt_core.recording.lock import FolderLock
from ldt_core.recording.mcap_reader import McapSummary, TolerantMcapReader
from ldt_core.recording.mcap_records import DAMAGE_ERRORS, LIBRARY
from ldt_core.recording.mcap_writer import McapWriter
from ldt_core.recording.messages import load
from ldt_core.recording.metadata import (
    METADATA,
    FileInformation,
    bag_information,
    channel_entry,
    listed_topics,
    text_of,
    write_metadata,
)
from ldt_core.recording.storage import Storage, free_name, is_mcap

DAMAGED_SUFFIX = ".damaged"  # behind the name of a file that was replaced
MENDED_BY = "ldt repair"  # the writer that a mended file names: its channels have other numbers
RECORDED = "recorded"  # key of the folder's custom data: which experiments the first files hold
COUNT_KEYS = ("message_count", "topics_with_message_count", "files")  # keys of the bag information
REQUIRED_KEYS = ("version", "storage_identifier", "relative_file_paths", *COUNT_KEYS[:2])
FREE_MARGIN = 1_000_000  # bytes that have to be free beside the size of what is written


@dataclass(frozen=True)
class Mended:
    """A file that was written anew.

    Args:
        file: its name.
        kept: where the damaged one is now.
        notes: what was wrong with it, a sentence each.
        recovered: topic → messages.
        missing: topic → messages that are known to have been there and are lost.
    """

    file: Path
    kept: Path
    notes: tuple[str, ...]
    recovered: Mapping[str, int]
    missing: Mapping[str, int]


@dataclass
class Repair:
    """What was done to a recording.

    Args:
        path: of the recording.
        mended: files that were written anew.
        metadata: why `metadata.yaml` was rewritten, "" when it was right.
        unmended: what is wrong and could not be put right, a sentence each.
        files: what each file holds now.
        topics: entries of `metadata.yaml` for what is in them.
    """

    path: Path
    mended: list[Mended] = field(default_factory=list)
    metadata: str = ""
    unmended: list[str] = field(default_factory=list)
    files: list[FileInformation] = field(default_factory=list)
    topics: list[dict[str, Any]] = field(default_factory=list)

    @property
    def sound(self) -> bool:
        """Whether there was nothing to do."""
        return not (self.mended or self.metadata or self.unmended)


def repair(path: str | Path) -> Repair:
    """Mend a recording.

    Args:
        path: rosbag2 folder, or a bare file; of a file in such a folder all of the folder.

    Raises:
        RecordingError: no recording; one that is being written; or nothing may be written there.
        LdtError: the disk is full or failed; the recording is as it was.
    """
    given = Path(path)
    whole = Storage(path)
    if not given.is_dir() and (given.parent / METADATA).is_file():
        beside = Storage(given.parent)
        whole = beside if given.name in [f.name for f in beside.files] else whole
    folder = whole.path if whole.path.is_dir() else whole.path.parent
    with FolderLock(folder):
        return mend(whole)


def mend(storage: Storage, quick: bool = False) -> Repair:
    """The same, of a recording whose folder's lock the caller holds.

    Args:
        storage: the recording.
        quick: rely on files that have an index at their end, without reading them.

    Raises:
        RecordingError, LdtError: as `repair`.
    """
    work = Repair(storage.path)
    sequences: dict[str, int] = {}
    topics: dict[str, dict[str, Any]] = {}
    counts: Counter[str] = Counter()
    try:
        for index, file in enumerate(storage.files):
            if not is_mcap(file):
                _unmendable(storage, file, work)
                continue
            begins = 0 if index == 0 or not quick else None
            found = _look(storage, file, quick, sequences, begins)
            if found.notes:
                _replace(file, found, work)
            work.files.append(found.facts)
            counts.update(found.counts)
            for entry in found.topics:
                topics.setdefault(entry["topic_metadata"]["name"], entry)
        for file in storage.unusable:
            _drop_empty(storage, file, work)
        topics |= listed_topics(_trusted(storage))  # with what another program says of them
        work.topics = [{**e, "message_count": counts[name]} for name, e in topics.items()]
        if storage.path.is_dir() and len(work.files) == len(storage.files):
            _renew_metadata(storage, work)
    except OSError as error:
        raise refused(storage.path, error) from None
    return work


class _Looked:
    """What reading one file showed."""

    def __init__(self, file: Path) -> None:
        self.mcap = TolerantMcapReader(file, self.note)
        self.notes: list[str] = []
        self.facts = FileInformation(file.name)
        self.counts: Counter[str] = Counter()
        self.missing: Counter[str] = Counter()
        self.topics: list[dict[str, Any]] = []
        self.before = (0, 0)  # size and time of change

    def note(self, sentence: str) -> None:
        """Add it, once."""
        if sentence not in self.notes:
            self.notes.append(sentence)


def _look(
    storage: Storage, file: Path, quick: bool, sequences: dict[str, int], begins: int | None
) -> _Looked:
    """Read a file.

    Args:
        storage: the recording.
        file: of it.
        quick: rely on the index.
        sequences: topic → sequence number that the next message should have; goes on here.
        begins: the sequence number of a topic's first message, None when it is not known.
    """
    looked = _Looked(file)
    looked.before = _stamp(file)
    looked.mcap = TolerantMcapReader(file, looked.note, lambda: storage.declared)
    summary = looked.mcap.summary(places=False)
    if quick and summary and summary.statistics and not looked.notes:
        _take_summary(looked, summary)
        return looked
    gaps: Counter[str] = Counter()
    for channel, _, message in looked.mcap.messages():
        looked.counts[channel.topic] += 1
        looked.facts = looked.facts.with_message(message.log_time)
        expected = sequences.get(channel.topic, begins)
        if expected is not None:
            gaps[channel.topic] += max(message.sequence - expected, 0)
        sequences[channel.topic] = message.sequence + 1
    described = summary.channels if summary else looked.mcap.described
    looked.topics = [channel_entry(*described[number]) for number in sorted(described)]
    if summary and summary.statistics:
        stated = summary.statistics.channel_message_counts
        there = Counter({described[n][0].topic: c for n, c in stated.items() if n in described})
        looked.missing = there - looked.counts
    elif looked.mcap.library == LIBRARY:
        looked.missing = +gaps
    if looked.missing:
        looked.note(f"{file}: {counted(sum(looked.missing.values()), 'message')} missing")
    return looked


def _take_summary(looked: _Looked, summary: McapSummary) -> None:
    said = summary.statistics
    assert said is not None
    for number, (channel, described) in sorted(summary.channels.items()):
        looked.counts[channel.topic] += said.channel_message_counts.get(number, 0)
        looked.topics.append(channel_entry(channel, described))
    if said.message_count:
        span = said.message_start_time, said.message_end_time
        looked.facts = FileInformation(looked.facts.name, said.message_count, *span)


def _replace(file: Path, looked: _Looked, work: Repair) -> None:
    """Write a file anew, and put it into the damaged one's place."""
    new = file.with_name(f"{file.name}.mending")
    with contextlib.suppress(FileNotFoundError):
        new.unlink()  # of a repair that was interrupted
    free = os.statvfs(file.parent)
    size = file.stat().st_size
    if free.f_bavail * free.f_frsize < size + FREE_MARGIN:
        raise OSError(errno.ENOSPC, f"{plain(size / 1e6)} MB are needed to rewrite {file.name}")
    try:
        _copy(looked, new)
        if _stamp(file) != looked.before:
            raise RecordingError(file, "a file that nobody is writing", "one that has changed")
        kept = free_name(file.with_name(file.name + DAMAGED_SUFFIX))
        try:
            os.link(file, kept)
        except OSError:  # a file system without links
            file.rename(kept)
        new.replace(file)
    finally:
        with contextlib.suppress(OSError):
            new.unlink()
    work.mended.append(Mended(file, kept, tuple(looked.notes), looked.counts, looked.missing))


def _copy(looked: _Looked, new: Path) -> None:
    """All messages of a damaged file into a sound one."""
    source = TolerantMcapReader(looked.mcap.path, lambda note: None, lambda: looked.mcap.described)
    part = McapWriter(new, MENDED_BY)
    try:
        described = looked.mcap.described
        numbers = {n: part.register(*described[n]) for n in sorted(described)}
        for channel, _, message in source.messages():
            part.add(
                numbers[channel.id],
                message.data,
                message.log_time,
                message.sequence,
                message.publish_time,
            )
        part.finish(text_of(bag_information(looked.topics, [looked.facts], {})))
    except BaseException:
        part.abandon()
        raise


def _renew_metadata(storage: Storage, work: Repair) -> None:
    """Write metadata.yaml if it does not say what the files hold."""
    old = _trusted(storage)
    lost = [name for name in storage.listed if name not in [f.name for f in work.files]]
    for name in lost:
        work.unmended.append(f"{storage.path}: {METADATA} lists {name}, which is missing")
    custom = old.get("custom_data")
    custom = dict(custom) if isinstance(custom, dict) else _custom_of(storage)
    _, covered = parse_numbers(custom.get(RECORDED))
    if any(m.file.name in [f.name for f in work.files[:covered]] for m in work.mended):
        custom.pop(RECORDED)  # it names what has been lost since
    new = bag_information(work.topics, work.files, custom, old)
    why = ""
    if not old:
        why = "it was missing or damaged"
    elif any(_counts(old, key) != _counts(new, key) for key in COUNT_KEYS):
        why = "it did not count what the files hold"
    if not why or lost:  # a file that may be put back stays listed
        return
    file = storage.path / METADATA
    if not old and file.exists() and file.stat().st_size:
        file.rename(free_name(file.with_name(file.name + DAMAGED_SUFFIX)))
    write_metadata(storage.path, text_of(new))
    work.metadata = why


def _trusted(storage: Storage) -> dict[str, Any]:
    """What metadata.yaml says, nothing where a part of it is missing."""
    said = storage.metadata
    return said if all(key in said for key in REQUIRED_KEYS) else {}


def _counts(said: Mapping[str, Any], key: str) -> Any:
    """What it counts, of a list by names; None when it is damaged."""
    try:
        if key == "files":
            return {PurePath(f["path"]).name: f["message_count"] for f in said[key]}
        if key == "topics_with_message_count":
            return {t["topic_metadata"]["name"]: t["message_count"] for t in said[key]}
        return said[key]
    except (TypeError, KeyError):
        return None


def _custom_of(storage: Storage) -> dict[str, str]:
    """What metadata.yaml held beside what rosbag2 needs, from the end of a file that has it."""
    for file in storage.files:
        said = {}
        with contextlib.suppress(*DAMAGE_ERRORS), file.open("rb") as stream:
            said = {r.name: r.metadata for r in make_reader(stream).iter_metadata()}
        text = said.get("rosbag2", {}).get("serialized_metadata", "")
        custom = described.get("custom_data") if isinstance(described := load(text), dict) else None
        if isinstance(custom, dict):
            return {k: v for k, v in custom.items() if k != RECORDED and isinstance(v, str)}
    return {}


def _unmendable(storage: Storage, file: Path, work: Repair) -> None:
    """A file that can be read as far as it goes, and not written anew."""
    before = len(storage.notes)
    for _ in storage.read(file):
        pass
    work.unmended += [
        f"{note} (only .mcap files can be repaired)" for note in storage.notes[before:]
    ]


def _drop_empty(storage: Storage, file: Path, work: Repair) -> None:
    """A file without a byte, of a writer that was killed at once, holds nothing to keep."""
    if file.stat().st_size == 0 and file.name not in storage.listed:
        file.unlink()
    else:
        work.unmended.append(f"{file}: holds nothing that can be read")


def _stamp(file: Path) -> tuple[int, int]:
    state = file.stat()
    return state.st_size, state.st_mtime_ns


def refused(path: Path, error: OSError) -> LdtError:
    """What to tell of a disk that is full or failed, or of a lacking right."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO):
        return LdtError(f"{path}: not repaired, and left unchanged: {error.strerror}")
    return RecordingError(path, "a recording that may be written", error.strerror or error)
