"""metadata.yaml of a rosbag2 folder, version 9, as ROS 2 Jazzy writes it."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from ldt_core.recording.messages import dump, offered_qos, schema
from ldt_core.recording.storage import METADATA

VERSION = 9


class Channel:
    """A topic of the file: its number there (0: none yet), its type, how often it was written."""

    def __init__(self, topic: str, kind: str) -> None:
        self.topic, self.kind = topic, kind
        self.number = self.count = 0


class Span:
    """First and last time of the messages [ns since the epoch], which need not come in order."""

    def __init__(self) -> None:
        self.first, self.last = -1, -1

    def add(self, time_ns: int) -> None:
        """Take in one message."""
        self.first = time_ns if self.first < 0 else min(self.first, time_ns)
        self.last = max(self.last, time_ns)


def information(
    channels: Collection[Channel], span: Span, file: str, custom: Mapping[str, str]
) -> str:
    """The bag information as YAML.

    Args:
        channels: all topics.
        span: of all messages.
        file: name of the MCAP file.
        custom: further texts by name; those that are empty are left out.
    """
    total = sum(c.count for c in channels)
    counted: dict[str, Any] = {
        "duration": {"nanoseconds": span.last - span.first},
        "starting_time": {"nanoseconds_since_epoch": max(span.first, 0)},
        "message_count": total,
    }
    topics = [
        {
            "topic_metadata": {
                "name": channel.topic,
                "type": channel.kind,
                "serialization_format": "cdr",
                "offered_qos_profiles": offered_qos(channel.topic),
                "type_description_hash": schema(channel.kind)[1],
            },
            "message_count": channel.count,
        }
        for channel in channels
    ]
    return dump(
        {
            "version": VERSION,
            "storage_identifier": "mcap",
            **counted,
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file],
            "files": [{"path": file, **counted}],
            "custom_data": {name: text for name, text in custom.items() if text} or None,
            "ros_distro": "jazzy",
        }
    )


def write_metadata(folder: Path, text: str) -> None:
    """Write bag information as the folder's metadata.yaml; a reader never meets half a file."""
    new = folder / f".{METADATA}.new"
    whole = "rosbag2_bagfile_information:\n" + textwrap.indent(text, "  ")
    try:
        new.write_text(whole, encoding="utf-8")
        os.replace(new, folder / METADATA)
    except OSError:
        new.unlink(missing_ok=True)
        raise
