"""metadata.yaml of a rosbag2 folder, version 9, as ROS 2 Jazzy writes it."""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from mcap.records import Channel, Schema

from ldt_core.base import result_files
from ldt_core.recording.messages import dump, load, offered_qos, schema

METADATA = "metadata.yaml"
VERSION = 9
MAX_METADATA = 10_000_000  # bytes of metadata.yaml; a large one has 100 kB


@dataclass
class TopicInformation:
    """A topic of a recording: its name, its type, how many messages of it were written."""

    name: str
    kind: str
    count: int = 0

    def entry(self) -> dict[str, Any]:
        """As `metadata.yaml` lists it."""
        digest = schema(self.kind)[1]
        return _entry(self.name, self.kind, "cdr", offered_qos(self.name), digest, self.count)


def _entry(
    name: str, kind: str, encoding: str, qos: list[Any], digest: str, count: int = 0
) -> dict[str, Any]:
    about: dict[str, Any] = {"name": name, "type": kind, "serialization_format": encoding}
    about |= {"offered_qos_profiles": qos, "type_description_hash": digest}
    return {"topic_metadata": about, "message_count": count}


class FileInformation(NamedTuple):
    """A file of a recording.

    Args:
        name: in the folder.
        messages: how many.
        first: time of the first message [ns since the epoch], -1 without messages.
        last: of the last one.
    """

    name: str
    messages: int = 0
    first: int = -1
    last: int = -1

    def with_message(self, time_ns: int) -> FileInformation:
        """One message more; they need not come in order."""
        first = time_ns if self.first < 0 else min(self.first, time_ns)
        return FileInformation(self.name, self.messages + 1, first, max(self.last, time_ns))

    def entry(self) -> dict[str, Any]:
        """As `metadata.yaml` lists it."""
        return {"path": self.name, **self._counted()}

    def _counted(self) -> dict[str, Any]:
        return {
            "duration": {"nanoseconds": self.last - self.first},
            "starting_time": {"nanoseconds_since_epoch": max(self.first, 0)},
            "message_count": self.messages,
        }

    @classmethod
    def of_all(cls, files: Collection[FileInformation]) -> dict[str, Any]:
        """Duration, start and count of several together."""
        first = min((f.first for f in files if f.messages), default=-1)
        last = max((f.last for f in files if f.messages), default=-1)
        return cls("", sum(f.messages for f in files), first, last)._counted()


def bag_information(
    topics: Sequence[Mapping[str, Any]],
    files: Sequence[FileInformation],
    custom: Mapping[str, str],
    base: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The bag information.

    Args:
        topics: entries of all topics.
        files: in their order.
        custom: further texts by name; those that are empty are left out.
        base: another program's bag information, whose other keys are kept.
    """
    return {
        "version": VERSION,
        "storage_identifier": "mcap",
        **FileInformation.of_all(files),
        "topics_with_message_count": list(topics),
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [f.name for f in files],
        "files": [f.entry() for f in files],
        "custom_data": {name: text for name, text in custom.items() if text} or None,
        "ros_distro": "jazzy",
        **{key: value for key, value in (base or {}).items() if key not in OURS},
    }


#: Keys that follow from the files; the others another program may have set.
OURS = (
    "duration",
    "starting_time",
    "message_count",
    "topics_with_message_count",
    "relative_file_paths",
    "files",
    "custom_data",
)


def channel_entry(channel: Channel, described: Schema | None) -> dict[str, Any]:
    """A topic as metadata.yaml lists it, by what a file says of its channel."""
    kind = described.name if described else channel.message_encoding
    offered = load(channel.metadata.get("offered_qos_profiles", ""))
    qos = offered if isinstance(offered, list) else []
    digest = channel.metadata.get("topic_type_hash", "")
    return _entry(channel.topic, kind, channel.message_encoding, qos, digest)


def read_metadata(file: Path) -> dict[str, Any]:
    """The bag information in metadata.yaml; empty when it is unusable, the files say enough."""
    try:
        if file.stat().st_size > MAX_METADATA:
            return {}
        data = load(file.read_text(encoding="utf-8"))
        info = data["rosbag2_bagfile_information"]
    except (ValueError, TypeError, KeyError):
        return {}
    return info if isinstance(info, dict) else {}


def listed_topics(metadata: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Topic → its entry in the bag information, of those that have a name and a type."""
    found = {}
    listed = metadata.get("topics_with_message_count")
    for entry in listed if isinstance(listed, list) else ():
        about = entry.get("topic_metadata") if isinstance(entry, dict) else None
        if isinstance(about, dict) and isinstance(about.get("type"), str):
            name = about.get("name")
            if isinstance(name, str):
                found[name] = entry
    return found


def write_metadata(folder: Path, text: str) -> None:
    """Write bag information as the folder's metadata.yaml; a reader never meets half a file."""
    whole = "rosbag2_bagfile_information:\n" + textwrap.indent(text, "  ")
    result_files.write(folder / METADATA, whole, sync=True)


def text_of(facts: Mapping[str, Any]) -> str:
    """Bag information as YAML."""
    return dump(dict(facts))
