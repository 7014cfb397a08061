"""Going on with a recording: what it holds, once it is mended, and whether it is the same run's."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.records import Channel, Message, Schema

import msgs_config
from ldt_core.base.errors import LdtError, RecordingError
from ldt_core.recording import run_settings
from ldt_core.recording.experiment_numbers import ExperimentNumbers, parse_numbers
from ldt_core.recording.mcap_completion import complete_file
from ldt_core.recording.mcap_reader import TolerantMcapReader
from ldt_core.recording.message_subject import number_of
from ldt_core.recording.messages import offered_qos
from ldt_core.recording.metadata import (
    METADATA,
    FileInformation,
    TopicInformation,
    listed_topics,
    read_metadata,
)
from ldt_core.recording.repair import RECORDED, Repair, mend, refused
from ldt_core.recording.storage import Storage

NUMBERED = re.compile(r"(.+)_(\d+)\.mcap")


@dataclass
class RecordedContents:
    """What a recording holds in its complete files.

    Args:
        custom: what `metadata.yaml` holds beside what rosbag2 needs.
        files: the complete ones.
        topics: by name, with the messages of each.
        numbers: topic → experiments that are recorded.
        stem: what the names of the files begin with, "" without files.
        index: of the next file.
        notes: what was damaged and is mended, a sentence each.
    """

    custom: dict[str, str]
    files: list[FileInformation] = field(default_factory=list)
    topics: dict[str, TopicInformation] = field(default_factory=dict)
    numbers: defaultdict[str, ExperimentNumbers] = field(
        default_factory=lambda: defaultdict(ExperimentNumbers)
    )
    stem: str = ""
    index: int = 0
    notes: list[str] = field(default_factory=list)

    def hold(self, topic: str, kind: str, data: bytes) -> None:
        """Take in a message that is recorded."""
        number = number_of(topic, kind, data)
        if number is not None:
            self.numbers[topic].add(number)


def resume_contents(
    folder: Path, custom: Mapping[str, str], wanted: Sequence[TopicInformation]
) -> RecordedContents:
    """Mend the end of a recording and say what it holds; the caller has the folder's lock.

    Files that have an index at their end are not read, but for the last one.

    Args:
        folder: of the recording; an empty one is a recording of nothing.
        custom: machine and settings of whoever goes on.
        wanted: topics that will be written.

    Raises:
        RecordingError: no recording; one of another machine, with other settings, or with topics of
            another type or quality of service.
        LdtError: it cannot be mended.
    """
    if not any(folder.iterdir()):
        return RecordedContents(dict(custom))
    # What a link points to is not this recording's: readers leave it out, too.
    begun = [f for f in sorted(folder.glob("*.mcap")) if f.stat().st_size and not f.is_symlink()]
    metadata = read_metadata(folder / METADATA) if (folder / METADATA).is_file() else {}
    if not begun and metadata:
        for file in folder.glob("*.mcap"):
            file.unlink()  # its writer was killed before the first byte
        return RecordedContents(_agreed(folder, metadata, custom))
    _check_topics(folder, metadata, wanted)
    agreed = _agreed(folder, metadata, custom)
    past = RecordedContents(agreed)
    finished = _finish(folder, begun, past)
    storage = Storage(folder)
    for topic in wanted:
        kind = storage.topics.get(topic.name, topic.kind)
        if kind != topic.kind:
            raise RecordingError(f"{folder}, {topic.name}", f"the recorded type {kind}", topic.kind)
    work = mend(storage, quick=True)
    if work.unmended:
        raise LdtError(f"{folder}: cannot be resumed: {'; '.join(work.unmended)}")
    storage = Storage(folder)
    past.custom = _agreed(folder, storage.metadata, custom)
    past.notes += [note for file in work.mended for note in file.notes]
    _fill(storage, work, past, finished)
    return past


def _finish(folder: Path, files: Sequence[Path], past: RecordedContents) -> set[str]:
    """Give the files of killed writers their index, the numbers in them to `past`; their names."""

    def take(channel: Channel, schema: Schema | None, message: Message) -> None:
        past.hold(channel.topic, schema.name if schema else "", message.data)

    about = {name: text for name, text in past.custom.items() if name != RECORDED}
    finished = set()
    for file in files:
        notes: list[str] = []
        try:
            TolerantMcapReader(file, notes.append).summary(places=False)
            if notes and complete_file(file, about, take):
                finished.add(file.name)
                past.notes += notes
        except OSError as error:
            raise refused(folder, error) from None
    return finished


def _fill(storage: Storage, work: Repair, past: RecordedContents, finished: set[str]) -> None:
    """Take in what the files hold; numbers from those that nobody has counted."""
    past.files = work.files
    for file in storage.files:
        if match := NUMBERED.fullmatch(file.name):
            past.stem, past.index = match[1], max(past.index, int(match[2]) + 1)
    if not past.stem:
        past.stem = storage.path.resolve().name
    for entry in work.topics:
        about = entry["topic_metadata"]
        name, count = about["name"], entry["message_count"]
        past.topics[name] = TopicInformation(name, about["type"], count)
    counted, covered = parse_numbers(past.custom.get(RECORDED))
    for topic, numbers in counted.items():
        past.numbers[topic].take(numbers)
    for file in storage.files[covered:]:
        if file.name not in finished:
            for raw in storage.read(file):
                past.hold(raw.topic, raw.kind, raw.data)


def _check_topics(
    folder: Path, metadata: dict[str, Any], wanted: Sequence[TopicInformation]
) -> None:
    recorded = listed_topics(metadata)
    for topic in wanted:
        where = f"{folder}, {topic.name}"
        about = recorded.get(topic.name, {}).get("topic_metadata", {})
        kind = about.get("type", topic.kind)
        if kind != topic.kind:
            raise RecordingError(where, f"the recorded type {kind}", topic.kind)
        offered = about.get("offered_qos_profiles")
        if offered and offered != offered_qos(topic.name):
            got = "another one; record into a new folder"
            raise RecordingError(where, "the recorded quality of service", got)


def _agreed(folder: Path, metadata: Mapping[str, Any], custom: Mapping[str, str]) -> dict[str, str]:
    """What the recording says of its run, which whoever goes on must not contradict."""
    found = metadata.get("custom_data")
    said = found if isinstance(found, dict) else {}
    recorded = {str(name): str(text) for name, text in said.items()}
    machine = recorded.get("machine", custom["machine"])  # a writer killed at once said nothing
    if custom["machine"] != machine:
        got = custom["machine"] or "none"
        raise RecordingError(folder, f"the recorded machine, {machine}", got)
    given, there = custom[run_settings.KEY], recorded.get(run_settings.KEY, "")
    if given and there:
        _compare(folder, there, given)
    return {**custom, **recorded}


def _compare(folder: Path, there: str, given: str) -> None:
    """Settings that one of the two lacks are at their defaults; of those of another version, none.

    The machine's file may stand elsewhere by now; what it says is in the run's key.
    """
    declared = msgs_config.parameters()
    old = run_settings.parse_settings(f"{folder}, settings", there)
    new = {name: value for name, value in json.loads(given).items() if name != "format"}
    free = {*run_settings.CHANGEABLE, run_settings.SECURE, "machine"}
    for name in sorted({*old, *new} & {*declared} - free):
        default = declared[name]["default"]
        recorded, wanted = old.get(name, default), new.get(name, default)
        if recorded != wanted:
            where = f"{folder}, {name}"
            raise RecordingError(where, f"{recorded!r}, as in the recording", repr(wanted))
