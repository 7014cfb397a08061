"""The machines of a run, their recordings, and the nodes of each one's graph."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ldt_core.base.errors import BadInput
from ldt_core.base.printable import file_name
from ldt_core.machine.machine_file import Machine
from ldt_core.models import learns_by_diagnosis
from ldt_core.recording.storage import RECORDINGS
from ldt_core.security.permissions import check_namespace

#: Nodes from which experiments can come.
SOURCES = ("plant", "player", "segmenter")


def new_recording(machine: str) -> Path:
    """A folder name that does not exist yet: machine and time under `ldt_recordings`."""
    stem = f"{file_name(Path(machine).stem)}-{time.strftime('%Y%m%d-%H%M%S')}"
    path = RECORDINGS / stem
    count = 1
    while path.exists():
        count += 1
        path = RECORDINGS / f"{stem}-{count}"
    return path


def roles(settings: Mapping[str, Any]) -> list[str]:
    """The nodes of one machine's graph, the recorder first: it misses nothing then.

    Where the model learns by the diagnosed effect the adaptor makes the diagnoses.
    """
    in_adaptor = learns_by_diagnosis(settings)
    beside = ["diagnoser"] if settings["diagnose"] and not in_adaptor else []
    beside += ["advisor"] if settings["advice"] else []
    return ["recorder", *beside, "adaptor", "detector", "twin", source_of(settings)]


def source_of(settings: Mapping[str, Any]) -> str:
    """The node from which a machine's experiments come."""
    if settings["source"]:
        return "segmenter"
    return "player" if settings["play"] else "plant"


@dataclass(frozen=True)
class Member:
    """One machine of a run.

    Args:
        namespace: of its topics, "" for the root.
    """

    name: str
    namespace: str
    settings: dict[str, Any]
    bag: Path


def fleet(machine: Machine, settings: Mapping[str, Any]) -> list[Member]:
    """The machines of a run, each with its own namespace, seed and recording.

    Raises:
        BadInput: a recording that exists, several machines for one recording to play, or a
            namespace that ROS could not have.
    """
    count = settings["machines"]
    if count > 1 and settings["play"]:
        raise BadInput("machines", "1 together with play", count)
    base = Path(settings["bag"]) if settings["bag"] else new_recording(machine.name)
    if base.exists() and not settings["resume"]:
        raise BadInput(base, "a folder that does not exist yet, for the recording", "one that does")
    members = []
    for index in range(count):
        name = f"machine_{index + 1}" if count > 1 else machine.name
        bag = base / name if count > 1 else base
        parts = [check_namespace(settings["namespace"]), name if count > 1 else ""]
        own = {**settings, "seed": settings["seed"] + index, "bag": str(bag)}
        own["resume"] = str(bag) if settings["resume"] else ""
        members.append(Member(name, "/".join(p for p in parts if p), own, bag))
    return members
