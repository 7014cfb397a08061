"""The health of a recording: is it whole, what is missing, what was refused while it was made."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import msgs_config
from ldt_core.base.bounded import forget_oldest
from ldt_core.base.errors import LdtError, RecordingError
from ldt_core.base.experiment import Adaptation, Experiment, ModelRecord, Prediction, Signal
from ldt_core.base.sentences import Span
from ldt_core.machine.experiment_limits import outsized
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import Bag, refuse_more_unusable
from ldt_core.recording.codec import DECODERS, Record, decode_cdr
from ldt_core.recording.experiment_numbers import ExperimentNumbers
from ldt_core.recording.lock import is_written
from ldt_core.recording.messages import deserialize
from ldt_core.recording.node_status import HEALTH_TOPIC, NodeStatus, node_statuses
from ldt_core.recording.run_settings import Setting
from ldt_core.recording.storage import RawMessage

_Key = tuple[int, float, int]  # of an experiment and its prediction: number, start, samples

ANSWERS = ("prediction", "signal", "adaptation")  # what each experiment of a run gets
MAX_PAUSES = 5  # pauses that are kept one by one
MAX_MATCHED = 1000  # experiments, or those with their prediction; a repetition comes soon after
PAUSE_SHARE = 1.0  # of an experiment's duration; a longer wait for the next is told
NO_DATE = 86400 * 365.0  # s after 1970-01-01: before it is a time that counts from a start


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
        numbers: of the experiments.
        experiments: how many there are; of a counter that begins anew, several have one number.
        repeated: numbers that were recorded more than once.
        samples: (samples, sample period [s]) → experiments that have it.
        backwards: numbers of experiments that start before the one recorded before them ends.
        pauses: number of an experiment → seconds after the end of the one recorded before it, where
            that is longer than an experiment; the longest ones.
        paused: how many such pauses there are.
        impossible: numbers of experiments that the machine cannot have made; where it does not ship
            with LDT, of those far beyond the others.
        why_impossible: why the first of them, "" where its size is.
        unreadable: absolute topic → (messages that are no such record, why the first is not).
        answered: topic of an answer → numbers of the experiments that got it.
        nodes: name of a node of this machine → what it told of itself last.
        settings: parameters of the run; none when the recording does not say.
        settings_trouble: why they cannot be read, in a sentence; "" when they can.
        models: kind → versions.
        detectors: names, of all signals.
        span: first and last time of a message [s since the epoch], None without messages.
        judged: whether a twin took part, which leaves out what it cannot use.
        writing: whether LDT was writing to it when it was looked at.
    """

    path: Path
    machine: str = ""
    files: dict[str, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    declared: int | None = None
    numbers: ExperimentNumbers = field(default_factory=ExperimentNumbers)
    experiments: int = 0
    repeated: ExperimentNumbers = field(default_factory=ExperimentNumbers)
    samples: Counter[tuple[int, float]] = field(default_factory=Counter)
    backwards: ExperimentNumbers = field(default_factory=ExperimentNumbers)
    pauses: dict[int, float] = field(default_factory=dict)
    paused: int = 0
    impossible: ExperimentNumbers = field(default_factory=ExperimentNumbers)
    why_impossible: str = ""
    unreadable: dict[str, tuple[int, str]] = field(default_factory=dict)
    answered: defaultdict[str, ExperimentNumbers] = field(
        default_factory=lambda: defaultdict(ExperimentNumbers)
    )
    nodes: dict[str, NodeStatus] = field(default_factory=dict)
    settings: Mapping[str, Setting] = field(default_factory=dict)
    settings_trouble: str = ""
    models: dict[str, set[int]] = field(default_factory=dict)
    detectors: set[str] = field(default_factory=set)
    span: tuple[float, float] | None = None
    judged: bool = False
    writing: bool = False

    @property
    def unrecorded(self) -> list[int]:
        """Numbers that got an answer, before the first recorded experiment or behind the last."""
        spans = self.numbers.spans
        found = {n for topic in ANSWERS[1:] for n in self.answered[topic]}
        return sorted(n for n in found if not (spans and spans[0][0] <= n <= spans[-1][1]))

    @property
    def missing(self) -> list[Span]:
        """Stretches of numbers between the first and the last experiment that are not recorded."""
        return self.numbers.gaps

    def unanswered(self, topic: str) -> list[int]:
        """Experiments without an answer of this kind."""
        return [number for number in self.numbers if number not in self.answered[topic]]


def inspect(bag: Bag, seen: Callable[[str, Record], object] | None = None) -> Health:
    """Read a recording from its first to its last message.

    Args:
        bag: the recording.
        seen: told of each record of the machine, with its topic's last part, so that nobody need
            read the recording once more for them.

    Raises:
        RecordingError: a file of it cannot be read any more, or a machine's recording holds more
            than MOST_UNUSABLE messages that are none.
    """
    metadata = bag.storage.metadata
    health = Health(bag.path, bag.machine, judged=bag.judged, writing=is_written(bag.path))
    try:
        health.settings = bag.settings()
    except RecordingError as error:
        health.settings_trouble = str(error)
    health.files = {f.name: f.stat().st_size for f in bag.storage.files}
    total = metadata.get("message_count")
    health.declared = total if isinstance(total, int) else None
    reading = _Reading(health, bag.namespace, seen)
    # All messages of all machines: what metadata.yaml counts, and what can be damaged.
    whole = 0
    for raw in bag.storage.messages():
        whole += 1
        if raw.topic in bag.topics:
            reading.take(raw)
    health.answered["prediction"] = reading.predicted()
    reading.hold_to_each_other()
    health.notes = damage(bag)
    if health.declared == whole:
        health.declared = None
    return health


def damage(bag: Bag) -> list[str]:
    """Notes of a recording, but for the file that is being written: it has no end yet."""
    notes = bag.notes
    if notes and is_written(bag.path):
        here = f"{bag.storage.files[-1]}: "
        notes = [note for note in notes if not note.startswith(here)]
    return notes


class _Reading:
    """Takes in one message after the other.

    Args:
        health: is filled.
        namespace: of the machine.
        seen: as of `inspect`.
    """

    def __init__(
        self,
        health: Health,
        namespace: str,
        seen: Callable[[str, Record], object] | None = None,
    ) -> None:
        self.health, self.namespace, self._seen = health, namespace, seen
        self._last: Experiment | None = None
        shipped = health.machine in msgs_config.machine_names()
        self._machine = load_machine(health.machine) if shipped else None
        self._sizes: dict[int, float] = {}  # largest speed by number
        # Those that wait for each other, and the last ones that did so no longer. A number may come
        # twice: the experiment that was predicted has the prediction's start.
        self._measured: set[_Key] = set()
        self._predicted: set[_Key] = set()
        self._matched: dict[_Key, None] = {}
        self._counted: dict[tuple[int, float], None] = {}  # number and start of the last ones

    def take(self, raw: RawMessage) -> None:
        """A message of this machine; what cannot be read is counted."""
        health, time = self.health, raw.time_ns / 1e9
        health.counts[raw.topic] += 1
        first, last = health.span or (time, time)
        health.span = (min(first, time), max(last, time))
        try:
            self._take(raw)
        except LdtError as error:
            count, why = health.unreadable.get(raw.topic, (0, str(error)))
            health.unreadable[raw.topic] = (count + 1, why)
            if not health.judged:
                refuse_more_unusable(count + 1, f"{health.path}, {raw.topic}")

    def predicted(self) -> ExperimentNumbers:
        """Numbers of the experiments of which no recorded one lacks its prediction."""
        lacking = {number for number, *_ in self._measured}
        found = ExperimentNumbers()
        for number in self.health.numbers:
            if number not in lacking:
                found.add(number)
        return found

    def _match(self, key: _Key, ours: set[_Key], others: set[_Key]) -> None:
        """Note one of a pair; when both have come, they need not be kept."""
        if key in self._matched:
            return
        if key not in others:
            ours.add(key)
            return
        others.remove(key)
        self._matched[key] = None
        forget_oldest(self._matched, MAX_MATCHED)

    def _take(self, raw: RawMessage) -> None:
        health, name = self.health, raw.topic.rpartition("/")[2]
        if raw.topic == HEALTH_TOPIC:
            message = deserialize(raw.data, raw.kind, raw.topic)
            health.nodes |= {s.name: s for s in node_statuses(message, self.namespace)}
            return
        if name not in DECODERS:
            return
        record = decode_cdr(name, raw.kind, raw.data, raw.topic)
        if self._seen is not None:
            self._seen(name, record)
        match record:
            case Experiment():
                self._measure(record)
            case Prediction() if name == "prediction":
                key = record.number, record.start, len(record)
                self._match(key, self._predicted, self._measured)
            case Signal() | Adaptation():
                health.answered[name].add(record.experiment)
                if isinstance(record, Signal):
                    health.detectors.add(record.detector)
            case ModelRecord():
                health.models.setdefault(record.kind, set()).add(record.version)

    def hold_to_each_other(self) -> None:
        """Note what is far beyond the others, where no machine says what is possible."""
        numbers = list(self._sizes)
        for place in outsized(list(self._sizes.values())):
            self.health.impossible.add(numbers[place])

    def _hold_to_machine(self, record: Experiment) -> None:
        if self._machine is None:
            self._sizes[record.number] = float(np.abs(record.speed).max())
            return
        try:
            self._machine.check(record)
        except LdtError as error:
            self.health.impossible.add(record.number)
            self.health.why_impossible = self.health.why_impossible or str(error)

    def _measure(self, record: Experiment) -> None:
        health = self.health
        if record.number in health.numbers:
            health.repeated.add(record.number)
        health.numbers.add(record.number)
        health.experiments += (record.number, record.start) not in self._counted
        self._counted[record.number, record.start] = None
        forget_oldest(self._counted, MAX_MATCHED)
        health.samples[len(record), record.period] += 1
        self._hold_to_machine(record)
        if self.health.judged:
            key = record.number, record.start, len(record)
            self._match(key, self._measured, self._predicted)
        if self._last is not None:
            wait = record.start - self._last.end
            if wait < -record.period:
                health.backwards.add(record.number)
            elif wait > PAUSE_SHARE * (self._last.end - self._last.start):
                health.paused += 1
                health.pauses[record.number] = wait
                if len(health.pauses) > MAX_PAUSES:
                    del health.pauses[min(health.pauses, key=health.pauses.__getitem__)]
        self._last = record
