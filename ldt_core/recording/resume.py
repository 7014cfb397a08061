"""Going on with a recording: what it holds, once it is mended, and whether it is the same run's."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgs_config
from ldt_core.errors import LdtError, RecordingError
from ldt_core.recording import run_settings
from ldt_core.recording.messages import offered_qos
from ldt_core.recording.metadata import FileFacts, Topic
from ldt_core.recording.numbers import Numbers, number_of, parse_numbers
from ldt_core.recording.repair import RECORDED, mend
from ldt_core.recording.storage import METADATA, Storage, read_metadata

NUMBERED = re.compile(r"(.+)_(\d+)\.mcap")


@dataclass
class Past:
    """What a recording held when it was taken up again.

    Args:
        custom: what `metadata.yaml` holds beside what rosbag2 needs.
        files: the complete ones.
        topics: with the messages of each.
        numbers: topic → experiments that are recorded.
        stem: what the names of the files begin with, "" without files.
        index: of the next file.
    """

    custom: dict[str, str]
    files: list[FileFacts] = field(default_factory=list)
    topics: list[Topic] = field(default_factory=list)
    numbers: dict[str, Numbers] = field(default_factory=dict)
    stem: str = ""
    index: int = 0


def continued(folder: Path, custom: Mapping[str, str], wanted: Sequence[Topic]) -> Past:
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
        return Past(dict(custom))
    begun = [f for f in folder.glob("*.mcap") if f.stat().st_size]
    metadata = read_metadata(folder / METADATA) if (folder / METADATA).is_file() else {}
    if not begun and metadata:
        for file in folder.glob("*.mcap"):
            file.unlink()  # its writer was killed before the first byte
        return Past(_agreed(folder, metadata, custom))
    storage = Storage(folder)
    _check_topics(storage, wanted)
    _agreed(folder, storage.metadata, custom)
    work = mend(storage, quick=True)
    if work.unmended:
        raise LdtError(f"{folder}: cannot be taken up again: {'; '.join(work.unmended)}")
    storage = Storage(folder)
    return _past(storage, _agreed(folder, storage.metadata, custom))


def _past(storage: Storage, custom: dict[str, str]) -> Past:
    past = Past(custom)
    counted = {entry["path"]: entry for entry in storage.metadata["files"]}
    for file in storage.files:
        past.files.append(FileFacts.of_entry(counted[file.name]))
        if match := NUMBERED.fullmatch(file.name):
            past.stem, past.index = match[1], max(past.index, int(match[2]) + 1)
    if not past.stem:
        past.stem = storage.path.resolve().name
    for entry in storage.metadata["topics_with_message_count"]:
        about = entry["topic_metadata"]
        past.topics.append(Topic(about["name"], about["type"], entry["message_count"]))
    past.numbers, covered = parse_numbers(custom.get(RECORDED))
    for file in storage.files[covered:]:
        for raw in storage.read(file):
            number = number_of(raw.topic, raw.kind, raw.data)
            if number is not None:
                past.numbers.setdefault(raw.topic, Numbers()).add(number)
    return past


def _check_topics(storage: Storage, wanted: Sequence[Topic]) -> None:
    recorded = {}
    for entry in storage.metadata.get("topics_with_message_count") or ():
        recorded[entry["topic_metadata"]["name"]] = entry["topic_metadata"]
    for topic in wanted:
        kind = storage.topics.get(topic.name, topic.kind)
        where = f"{storage.path}, {topic.name}"
        if kind != topic.kind:
            raise RecordingError(where, f"the recorded type {kind}", topic.kind)
        offered = recorded.get(topic.name, {}).get("offered_qos_profiles")
        if offered and offered != offered_qos(topic.name):
            got = "another one; record into a new folder"
            raise RecordingError(where, "the recorded quality of service", got)


def _agreed(folder: Path, metadata: Mapping[str, Any], custom: Mapping[str, str]) -> dict[str, str]:
    """What the recording says of its run, which whoever goes on must not contradict."""
    found = metadata.get("custom_data")
    recorded = dict(found) if isinstance(found, dict) else {}
    machine = recorded.get("machine", custom["machine"])  # a writer killed at once said nothing
    if custom["machine"] != machine:
        got = custom["machine"] or "none"
        raise RecordingError(folder, f"the recorded machine, {machine}", got)
    given, there = custom[run_settings.KEY], recorded.get(run_settings.KEY, "")
    if given and there:
        _compare(folder, there, given)
    return {**custom, **recorded}


def _compare(folder: Path, there: str, given: str) -> None:
    """Settings that one of the two lacks are at their defaults."""
    declared = msgs_config.parameters()
    old = run_settings.parse_settings(f"{folder}, settings", there)
    new = {name: value for name, value in json.loads(given).items() if name != "format"}
    for name in sorted({*old, *new} - {*run_settings.FREE}):
        default = declared.get(name, {}).get("default")
        recorded, wanted = old.get(name, default), new.get(name, default)
        if recorded != wanted:
            where = f"{folder}, {name}"
            raise RecordingError(where, f"{recorded!r}, as in the recording", repr(wanted))
