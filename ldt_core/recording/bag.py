"""Reading a recording: its machine, its records, what is wrong with it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, overload

import msgs_config
from ldt_core.base.errors import BadInput, ExperimentError, RecordingError
from ldt_core.base.experiment import (
    Adaptation,
    AdviceRecord,
    DiagnosisRecord,
    Experiment,
    ModelRecord,
    Prediction,
    Signal,
)
from ldt_core.base.sentences import counted, numbered, some
from ldt_core.recording.codec import DECODERS, Record, decode_cdr
from ldt_core.recording.experiment_numbers import ExperimentNumbers, parse_selection
from ldt_core.recording.messages import deserialize, quoted
from ldt_core.recording.run_settings import KEY, Setting, parse_settings
from ldt_core.recording.storage import RawMessage, Storage

if TYPE_CHECKING:
    from ldt_core.machine.machine_file import Machine

MAX_LISTED_SPANS = 5  # stretches of numbers that a note names one by one
#: Messages that are none, of a machine alone, after which its recording is not read on: a second of
#: a processor, and more experiments than a long run has.
MOST_UNUSABLE = 100_000


class Recorded(NamedTuple):
    """Experiments of a recording, and a sentence for each thing that is odd about it."""

    experiments: list[Experiment]
    notes: list[str]


class Bag:
    """One machine's topics in a recording; `read_bag` makes it.

    Args:
        storage: the files.
        namespace: of the machine ("/machine_1"), "" for the root.
        only: experiments that `experiments` gives, as of `parse_selection`; "" for all.
    """

    def __init__(self, storage: Storage, namespace: str, only: str = "") -> None:
        self.storage, self.namespace = storage, namespace
        self._chosen = parse_selection(only) if only else None
        self.path = storage.path
        self._place = str(storage.path)
        #: Absolute topic → message type, of this machine and of no machine (`/diagnostics`).
        self.topics = {
            topic: kind
            for topic, kind in storage.topics.items()
            if topic.rpartition("/")[0] == namespace or topic in msgs_config.topics()
        }

    @property
    def machine(self) -> str:
        """Its name, "" when the recording does not say."""
        return self.custom("machine")

    def other_machine(self, machine: Machine) -> str:
        """A sentence where the recording is not of this machine; "" where it is, or does not say.

        That is no error: another machine's model may well be tried on it. But a mistaken file shows
        in nothing else than large errors. Of one machine there are many files, calibrated ones for
        some.
        """
        if not self.machine or self.machine == machine.name:
            return ""
        there, here = quoted(self.machine), quoted(machine.name)
        return f"{self.path}: recorded of the machine {there}, while the machine file is of {here}"

    def settings(self) -> dict[str, Setting]:
        """Parameters of the run by name, none when the recording does not say.

        Raises:
            RecordingError: what stands there are no settings, or those of another version.
        """
        if KEY not in self._custom:
            return {}
        return parse_settings(f"{self.path}, settings", self._custom[KEY])

    def custom(self, name: str) -> str:
        """A text beside what rosbag2 needs, by name; "" when the recording has none."""
        return str(self._custom.get(name) or "")

    @property
    def _custom(self) -> dict[Any, Any]:
        """What `metadata.yaml` holds beside what rosbag2 needs."""
        custom = self.storage.metadata.get("custom_data")
        return custom if isinstance(custom, dict) else {}

    @property
    def notes(self) -> list[str]:
        """What is odd about the recording, a sentence each; complete when all has been read."""
        return self.storage.notes

    def topic(self, name: str) -> str | None:
        """A topic's absolute name by that or by its last part; None when the recording lacks it."""
        absolute = name if name in self.topics else f"{self.namespace}/{name}"
        return absolute if absolute in self.topics else None

    def messages(self, *names: str, begin: tuple[int, int] = (0, 0)) -> Iterator[RawMessage]:
        """Stored messages (CDR bytes) in recorded order, of the named topics or of all of them.

        Args:
            names: last parts of topics; of those that the recording lacks nothing comes.
            begin: as of `Storage.messages`.
        """
        topics = [t for n in names if (t := self.topic(n))] if names else list(self.topics)
        return self.storage.messages(topics, begin) if topics else iter(())

    @overload
    def records(self, name: Literal["experiment"]) -> Iterator[Experiment]: ...
    @overload
    def records(
        self, name: Literal["prediction", "original_prediction"]
    ) -> Iterator[Prediction]: ...
    @overload
    def records(self, name: Literal["signal"]) -> Iterator[Signal]: ...
    @overload
    def records(self, name: Literal["adaptation"]) -> Iterator[Adaptation]: ...
    @overload
    def records(self, name: Literal["model"]) -> Iterator[ModelRecord]: ...
    @overload
    def records(self, name: Literal["diagnosis"]) -> Iterator[DiagnosisRecord]: ...
    @overload
    def records(self, name: Literal["advice"]) -> Iterator[AdviceRecord]: ...
    @overload
    def records(self, name: str) -> Iterator[Any]: ...
    def records(self, name: str) -> Iterator[Any]:
        """Records of a topic in recorded order, one at a time; messages where none is declared.

        Args:
            name: last part of the topic ("experiment"); none come where the recording lacks it.

        Raises:
            RecordingError: the recording holds something else under the topic's name.
            RecordingError, ExperimentError, ModelError: as `usable`.
        """
        return self._records(name)

    def _records(
        self, name: str, refused: Callable[[BadInput], None] | None = None
    ) -> Iterator[Any]:
        topic = self.topic(name)
        if topic and name in DECODERS and self.topics[topic] != DECODERS[name][0]:
            raise RecordingError(f"{self.path}, {topic}", DECODERS[name][0], self.topics[topic])
        return (record for _, record in self.usable(self.messages(name), True, refused))

    def rare(self, name: str) -> Iterator[Any]:
        """As `records`, of a topic that has few: files are not read where they have none.

        Raises:
            RecordingError, ExperimentError, ModelError: as `usable`.
        """
        topic = self.topic(name)
        picked = self.storage.picked([topic]) if topic else ()
        return (record for _, record in self.usable(picked, whole=True))

    def usable(
        self,
        raws: Iterable[RawMessage],
        whole: bool = False,
        refused: Callable[[BadInput], None] | None = None,
    ) -> Iterator[tuple[RawMessage, Any]]:
        """Messages with the records in them; messages themselves where none is declared.

        What a twin cannot use when it comes it counts and leaves out, whoever has sent it; so it is
        left out here, with a note.

        Args:
            raws: of any topics, as stored.
            whole: whether these are all of their topics.
            refused: told of each message that is no such record, in a recording of a machine
                alone; None notes them.

        Raises:
            RecordingError, ExperimentError, ModelError: a whole topic of nothing but messages that
                are no such record; says the first. More than MOST_UNUSABLE of them, in a recording
                of a machine alone.
        """
        used: set[str] = set()
        left_out: Counter[str] = Counter()
        first: dict[str, BadInput] = {}
        for index, raw in enumerate(raws, start=1):
            try:
                record = self.decoded(raw, index)
            except BadInput as error:
                first.setdefault(raw.topic, error)
                left_out[raw.topic] += 1
                if not self.judged:
                    if refused is not None:
                        refused(error)
                    refuse_more_unusable(left_out[raw.topic], f"{self._place}, {raw.topic}")
                continue
            used.add(raw.topic)
            yield raw, record
        for topic, unusable in first.items():
            if whole and topic not in used:
                raise unusable
        for topic, count in left_out.items() if refused is None or self.judged else ():
            self.storage.note(
                f"{self.path}: {counted(count, 'message')} of {topic} left out, as a twin does, "
                f"the first because {first[topic]}"
            )

    @property
    def judged(self) -> bool:
        """Whether a twin took part, and not the machine alone."""
        return self.topic("prediction") is not None

    def decoded(self, raw: RawMessage, index: int) -> Record | Any:
        """The record in one of the messages, the message itself where none is declared.

        Args:
            raw: as stored.
            index: by which a sentence calls it, from 1.

        Raises:
            RecordingError, ExperimentError, ModelError: no such record; says which one.
        """
        name = raw.topic.rpartition("/")[2]
        where = f"{self._place}, {raw.topic}, message {index}"
        if name in DECODERS:
            return decode_cdr(name, raw.kind, raw.data, where)
        return deserialize(raw.data, raw.kind, where)

    def experiments(
        self, machine: Machine | None = None, refused: Callable[[BadInput], None] | None = None
    ) -> Iterator[Experiment]:
        """Experiments in recorded order; notes repeated and missing numbers.

        Args:
            machine: what it cannot have made is left out, as a twin does, and noted; None when it
                is not known.
            refused: as of `usable`.

        Raises:
            RecordingError: the recording has no experiments, or none of those chosen.
            ExperimentError: nothing but messages that are no experiment, or experiments that the
                machine cannot have made; says the first.
        """
        if self.topic("experiment") is None:
            wanted = f"the topic {self.namespace}/experiment"
            raise RecordingError(self.path, wanted, f"only {some(sorted(self.topics))}")
        seen, repeated, impossible = (ExperimentNumbers() for _ in range(3))
        kept, why = 0, None
        for experiment in self._records("experiment", refused):
            if experiment.number in seen:
                repeated.add(experiment.number)
            seen.add(experiment.number)
            if self._chosen is not None and experiment.number not in self._chosen:
                continue
            if machine is not None:
                try:
                    machine.check(experiment)
                except ExperimentError as error:
                    where = f"{self.path}, {error.where}"
                    why = why or ExperimentError(where, error.expected, error.got)
                    impossible.add(experiment.number)
                    continue
            kept += 1
            yield experiment
        if not seen:
            where = f"{self.path}, {self.topic('experiment')}"
            raise RecordingError(where, "experiments", f"none{_because(self.storage)}")
        if not kept and why is None:
            there = numbered("experiment", seen.spans, MAX_LISTED_SPANS)
            raise RecordingError(f"{self.path}, --only", f"some of {there}", "none of them")
        if why is not None:
            if not kept:
                raise why
            told = numbered("experiment", impossible.spans, MAX_LISTED_SPANS)
            self.storage.note(f"{why}; left out, as a twin does: {told}")
        if repeated:
            told = numbered("experiment", repeated.spans, MAX_LISTED_SPANS)
            self.storage.note(f"{self.path}: recorded more than once: {told}")
        for before, after in seen.jumps[:MAX_LISTED_SPANS]:
            self.storage.note(f"{self.path}: after experiment {before} comes {after}")
        if missing := seen.gaps:
            told = numbered("experiment", missing, MAX_LISTED_SPANS)
            self.storage.note(f"{self.path}: missing: {told}")


def read_bag(
    path: str | Path, namespace: str | None = None, listed: bool = False, only: str = ""
) -> Bag:
    """Open a recording.

    Args:
        path: rosbag2 folder or a bare file of one (`.mcap`, `.mcap.zstd`, `.db3`).
        namespace: which machine, with or without its leading slash; "/" is the root; None or ""
            when there is only one.
        listed: as of `Storage`.
        only: as of `Bag`.

    Raises:
        OptionError: `only` names no numbers.
        RecordingError: nothing there, empty, foreign, several machines, or no such one.
    """
    storage = Storage(path, listed)
    machines = namespaces(storage.topics)
    if not machines:
        there = some([f"{t} ({k})" for t, k in sorted(storage.topics.items())]) or "no messages"
        got = f"only {there}" if storage.topics else f"{there}{_because(storage)}"
        wanted = "a topic named experiment (ldt import makes one of any other recording)"
        raise RecordingError(path, wanted, got)
    if not namespace:
        if len(machines) > 1:
            shown = some([m or "/" for m in machines])
            raise RecordingError(
                path, "one machine, or a namespace to choose one (--namespace)", f"{shown}"
            )
        return Bag(storage, machines[0], only)
    wanted = "/" + namespace.strip("/") if namespace.strip("/") else ""
    if wanted not in machines:
        shown = some([m or "/" for m in machines])
        raise RecordingError(path, f"a machine under {wanted or '/'}", f"only {shown}")
    return Bag(storage, wanted, only)


def read_twin_run(path: str | Path, namespace: str | None = None) -> Bag:
    """Open a recording of a twin that predicted and judged.

    Raises:
        RecordingError: as `read_bag`, or a machine's experiments alone.
    """
    bag = read_bag(path, namespace)
    missing = [t for t in ("experiment", "prediction", "signal") if bag.topic(t) is None]
    if missing:
        other = "" if "prediction" in missing else "; ldt plot shows predictions alone"
        raise RecordingError(
            bag.path,
            f"a run of a twin (ldt replay makes one of experiments{other})",
            f"no topic {' and no topic '.join(missing)}",
        )
    return bag


def experiments(path: str | Path, namespace: str | None = None) -> Recorded:
    """All experiments of one machine in a recording, in memory.

    Raises:
        RecordingError: as `read_bag`, or without experiments.
        ExperimentError: nothing but messages that are no experiment.
    """
    bag = read_bag(path, namespace)
    found = list(bag.experiments())
    return Recorded(found, bag.notes)


def namespaces(topics: dict[str, str]) -> list[str]:
    """Namespaces that hold experiments; without any, those that hold another of our topics."""
    ours = [
        t for t, kind in topics.items() if DECODERS.get(t.rpartition("/")[2], "")[:1] == (kind,)
    ]
    measured = [t for t in ours if t.endswith("/experiment")]
    return sorted({t.rpartition("/")[0] for t in measured or ours})


def refuse_more_unusable(count: int, where: str) -> None:
    """Refuse a recording of a machine alone with more messages that are none than are read.

    Raises:
        RecordingError: more than MOST_UNUSABLE.
    """
    if count > MOST_UNUSABLE:
        few = f"at most {MOST_UNUSABLE} messages that are no such record"
        raise RecordingError(where, few, "more") from None


def _because(storage: Storage) -> str:
    return f" ({'; '.join(storage.notes)})" if storage.notes else ""
