"""The health of a recording: is it whole, what is missing, what was refused while it was made."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ldt_core.errors import LdtError
from ldt_core.experiment import Adaptation, Experiment, ModelRecord, Prediction, Signal
from ldt_core.recording.bag import read_bag
from ldt_core.recording.codec import DECODERS, decode
from ldt_core.recording.messages import deserialize
from ldt_core.recording.storage import Raw

HEALTH_TOPIC = "/diagnostics"
REJECTED = "rejected "  # how the keys begin under which a node counts what it refused
ANSWERS = ("prediction", "signal", "adaptation")  # what each experiment of a run gets


@dataclass
class Health:
    """What one reading of a whole recording shows of one machine.

    Args:
        path: of the recording.
        machine: its name as recorded, "" when it is not.
        files: name → bytes.
        notes: what is damaged or missing in the files, a sentence each.
        counts: absolute topic → messages that could be read.
        declared: messages that `metadata.yaml` counts, None when it does not say.
        numbers: experiment number → how often it was recorded.
        samples: (samples, sample period [s]) → experiments that have it.
        backwards: numbers of experiments that start before the one recorded before them ends.
        unreadable: absolute topic → (messages that are no such record, why the first is not).
        answered: topic of an answer → numbers of the experiments that got it.
        rejected: node and what it refused → how many messages, as it told itself.
        last_rejection: why, of each node.
        models: kind → versions.
        detectors: names, of all signals.
        span: first and last time of a message [s since the epoch], None without messages.
    """

    path: Path
    machine: str = ""
    files: dict[str, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    declared: int | None = None
    numbers: Counter[int] = field(default_factory=Counter)
    samples: Counter[tuple[int, float]] = field(default_factory=Counter)
    backwards: list[int] = field(default_factory=list)
    unreadable: dict[str, tuple[int, str]] = field(default_factory=dict)
    answered: dict[str, set[int]] = field(default_factory=dict)
    rejected: dict[str, int] = field(default_factory=dict)
    last_rejection: dict[str, str] = field(default_factory=dict)
    models: dict[str, set[int]] = field(default_factory=dict)
    detectors: set[str] = field(default_factory=set)
    span: tuple[float, float] | None = None

    @property
    def missing(self) -> list[int]:
        """Numbers between the first and the last experiment that were not recorded."""
        if not self.numbers:
            return []
        first, last = min(self.numbers), max(self.numbers)
        # A number may claim anything; nobody reads more than the first few that are missing.
        few = range(first, min(last, first + 10 * len(self.numbers) + 1000) + 1)
        return [n for n in few if n not in self.numbers]

    @property
    def repeated(self) -> list[int]:
        """Numbers that were recorded more than once."""
        return sorted(n for n, times in self.numbers.items() if times > 1)

    def unanswered(self, topic: str) -> list[int]:
        """Experiments without an answer of this kind."""
        return sorted(set(self.numbers) - self.answered.get(topic, set()))


def inspect(path: str | Path, namespace: str = "") -> Health:
    """Read a recording from its first to its last message.

    Args:
        path: rosbag2 folder or a bare file of one.
        namespace: which machine, if there are several.

    Raises:
        RecordingError: as `read_bag`.
    """
    bag = read_bag(path, namespace)
    metadata = bag.storage.metadata
    custom = metadata.get("custom_data")
    health = Health(bag.path)
    health.machine = str(custom.get("machine", "")) if isinstance(custom, dict) else ""
    health.files = {f.name: f.stat().st_size for f in bag.storage.files}
    total = metadata.get("message_count")
    health.declared = total if isinstance(total, int) else None
    end = float("-inf")
    # All messages of all machines: what metadata.yaml counts, and what can be damaged.
    whole = 0
    for raw in bag.storage.messages():
        whole += 1
        if raw.topic not in bag.topics:
            continue
        health.counts[raw.topic] += 1
        time = raw.time_ns / 1e9
        health.span = (
            (min(health.span[0], time), max(health.span[1], time))
            if health.span
            else (
                time,
                time,
            )
        )
        try:
            end = _take(health, raw, bag.namespace, end)
        except LdtError as error:
            count, why = health.unreadable.get(raw.topic, (0, str(error)))
            health.unreadable[raw.topic] = (count + 1, why)
    health.notes = bag.notes
    if health.declared == whole:
        health.declared = None
    return health


def _take(health: Health, raw: Raw, namespace: str, end: float) -> float:
    """Take one message in; the end of the last experiment so far."""
    name = raw.topic.rpartition("/")[2]
    if raw.topic == HEALTH_TOPIC:
        _take_status(health, deserialize(raw.data, raw.kind, raw.topic), namespace)
        return end
    if name not in DECODERS:
        return end
    record = decode(name, deserialize(raw.data, raw.kind, raw.topic), raw.topic)
    match record:
        case Experiment():
            health.numbers[record.number] += 1
            health.samples[len(record), record.period] += 1
            if record.start < end - record.period:
                health.backwards.append(record.number)
            return record.end
        case Prediction():
            health.answered.setdefault(name, set()).add(record.number)
        case Signal() | Adaptation():
            health.answered.setdefault(name, set()).add(record.experiment)
            if isinstance(record, Signal):
                health.detectors.add(record.detector)
        case ModelRecord():
            health.models.setdefault(record.kind, set()).add(record.version)
    return end


def _take_status(health: Health, message: Any, namespace: str) -> None:
    """What the nodes of this machine told of themselves; their counts grow, the last is whole."""
    for status in message.status:
        if status.name.rpartition("/")[0] != namespace.strip("/"):
            continue
        for pair in status.values:
            if pair.key == "last rejection":
                health.last_rejection[status.name] = pair.value
            elif pair.key.startswith(REJECTED) and pair.value.isdigit():
                health.rejected[f"{status.name} {pair.key}"] = int(pair.value)
