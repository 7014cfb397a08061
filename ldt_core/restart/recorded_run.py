"""What a recording has of one machine's run, read from its beginning or near an experiment."""

from __future__ import annotations

import contextlib
import itertools
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from ldt_core.base.bounded import forget_oldest
from ldt_core.base.errors import BadInput, LdtError
from ldt_core.base.experiment import Action, Adaptation, Experiment, ModelRecord, Prediction, Signal
from ldt_core.machine.machine_file import Machine
from ldt_core.recording.bag import Bag
from ldt_core.recording.message_subject import Subject, agree, said_of
from ldt_core.recording.step_search import ANCHOR, StepSearch
from ldt_core.recording.storage import Storage
from ldt_core.twin.adaptor import ROLLED_BACK
from ldt_core.twin.stage import WINDOW, RecordedStep

#: In place of an experiment's number: the last one, whichever it is.
END = sys.maxsize
#: Steps before a place at which reading begins: what is cut off there has no say in what follows.
MARGIN = 2 * WINDOW
#: Bytes at the end of a recording that are looked at first, then ever more.
TAIL = 2**18
#: Time after which a recording that could not be read is tried again [s].
MENDING = 0.3

#: Topics of which a step consists.
LOOP = ("experiment", "prediction", "signal", "adaptation", "model")
#: Topic from which nothing is computed.
YARDSTICK = "original_prediction"
#: Topics whose records may come long after their step.
BESIDE = ("diagnosis", "advice")


@dataclass(frozen=True)
class RecordedRun:
    """The run of one machine in a recording that may not exist yet, or be written at this moment.

    Args:
        namespace: of the machine, "/" for the root.
        machine: what it cannot have made was refused, whatever its number.
    """

    path: str | Path
    namespace: str
    machine: Machine

    def bag(self, listed: bool = False) -> Bag | None:
        """The recording, None where nothing of the machine was recorded yet.

        Raises:
            RecordingError: what stands there is no recording, or none that can be read.
        """
        if not Path(self.path).exists():
            return None
        storage = Storage(self.path, listed)
        name = self.namespace.strip("/")
        absolute = f"/{name}" if name else ""
        return Bag(storage, absolute) if f"{absolute}/experiment" in storage.topics else None

    def steps(self, *around: int) -> Iterator[RecordedStep]:
        """Complete steps; none where nothing of the machine was recorded yet.

        Args:
            around: numbers of experiments, or `END`; none, or 0 among them, for all steps. Reading
                begins at least `WINDOW` steps before all of them, the last ones of their numbers
                where a counter began anew. It takes as long as what follows there is long.
        """
        tail = self._tail(around) if around and min(around) > WINDOW else None
        if tail is not None:
            yield from tail
            return
        bag = self.bag()
        if bag is not None:
            yield from complete_steps(bag, self.machine)

    def last_of(self, topic: str, around: int = 0) -> Subject:
        """The last experiment that a record of a topic is about or is: number and time [s].

        Args:
            around: as of `steps`; what was recorded before that place does not count.

        Returns:
            As `said_of` of the record, (0, 0.0) without any.
        """
        if around > WINDOW:
            with contextlib.suppress(LdtError, OSError):
                bag = self.bag(listed=True)
                begin = None if bag is None else _begin_before(bag, (around,))
                if bag is not None and begin is not None:
                    return last_said(bag, topic, begin)
        bag = self.bag()
        return (0, 0.0) if bag is None else last_said(bag, topic)

    def _tail(self, around: Sequence[int]) -> Iterator[RecordedStep] | None:
        """None where such a place cannot be found.

        Enough steps come before that experiment that what may be left out there, or be told late,
        has no say in what follows.
        """
        for again in (True, False):
            try:
                return self._steps_around(around)
            except (LdtError, OSError):  # its recorder may be mending it at this moment
                if again:
                    time.sleep(MENDING)
        return None  # whoever reads all of it says what is wrong, or reads on behind it

    def _steps_around(self, around: Sequence[int]) -> Iterator[RecordedStep] | None:
        bag = self.bag(listed=True)
        begin = None if bag is None else _begin_before(bag, around)
        if bag is None or begin is None:
            return None
        steps = complete_steps(bag, self.machine, begin)
        before = list(itertools.islice(steps, WINDOW))
        return itertools.chain(before, steps) if len(before) == WINDOW else None


def _begin_before(bag: Bag, around: Sequence[int]) -> tuple[int, int] | None:
    """File and byte `MARGIN` steps before the last ones of these numbers; None near the beginning.

    It looks from the end on backwards: numbers begin anew where a counter does, so that their
    order in a recording says nothing of its beginning.
    """
    if bag.topic(ANCHOR) is None:
        return None
    search, back = StepSearch(bag), TAIL
    while True:
        found = list(search.all_from(max(search.end - back, 0)))
        places = {step.number: place for place, step in enumerate(found)}
        wanted = (len(found) if n == END else _at_most(places, n) for n in around)
        first = min(wanted) - MARGIN
        if first >= 0:
            return search.begin(found[first].address)
        if back >= search.end:
            return None
        back *= 4


def _at_most(places: Mapping[int, int], number: int) -> int:
    """Where the last of this number is, or of the one nearest below it; -1 where there is none."""
    if number in places:
        return places[number]
    return places[max(below)] if (below := [n for n in places if n < number]) else -1


def last_said(bag: Bag, topic: str, begin: tuple[int, int] = (0, 0)) -> Subject:
    """Number and time of the last record of a topic, (0, 0.0) where there is none."""
    name = bag.topic(topic)
    if name is None:
        return 0, 0.0
    found = bag.storage.picked([name]) if begin == (0, 0) else bag.messages(topic, begin=begin)
    last = 0, 0.0
    for raw in found:
        last = said_of(raw.topic, raw.kind, raw.data) or last
    return last


class _Compared(NamedTuple):
    """What a prediction of the original model is about."""

    number: int
    start: float


Recorded = Experiment | Prediction | Signal | Adaptation | ModelRecord | _Compared
_Complete = tuple[Experiment, Prediction, Signal, Adaptation, ModelRecord | None]


@dataclass
class _Open:
    """What has been read of a step so far."""

    experiments: list[Experiment] = field(default_factory=list)
    prediction: Prediction | None = None
    signal: Signal | None = None
    adaptation: Adaptation | None = None
    original: bool = False

    @property
    def experiment(self) -> Experiment | None:
        """The one that was predicted; a number may have been sent for several."""
        if self.prediction is None:
            return None
        return next((e for e in self.experiments if e.start == self.prediction.start), None)

    @property
    def begun(self) -> bool:
        """Whether the twin took the experiment; one that it refused never goes on."""
        return not (self.prediction is None and self.signal is None and self.adaptation is None)


def complete_steps(
    bag: Bag, machine: Machine, begin: tuple[int, int] = (0, 0)
) -> Iterator[RecordedStep]:
    """Complete steps of a recording in the order in which they were made, up to where it ends.

    A step is complete once its experiment, prediction, signal, adaptation and the model that goes
    on are recorded. What comes after the last one is done again, and comes out the same.

    A node that was started again may have sent its messages in another order, and some twice: the
    first of each counts. A step that stays incomplete while `WINDOW` later ones come is left out.
    Steps come by their numbers until a counter begins anew, which shows by a number that is not
    above the last one's, predicted at another start.
    Where somebody has rolled the twin back after a step, that is how the step ended. A model that
    was adopted after an experiment that the recorder missed comes with the next step. A message
    that is none of its topic's is left out, as the nodes did when it came.

    Args:
        bag: as `read_bag` opened it; may be one that is being written.
        machine: what it cannot have made was refused, whatever its number.
        begin: file and byte before which nothing is read (`Storage.messages`).
    """
    beside = {name: said_beside(bag, name, begin) for name in BESIDE}
    models: dict[int, ModelRecord] = {}
    counted = _Counted(models, bag.topic(YARDSTICK) is not None)
    held: RecordedStep | None = None  # the last step, after which a rollback may come
    for name, record in _messages(bag, begin):
        if isinstance(record, ModelRecord):
            models[record.version] = record
            forget_oldest(models, 2 * WINDOW)
        elif isinstance(record, Experiment) and not machine.may_have_made(record):
            continue
        else:
            if isinstance(record, Adaptation) and held and record.number == held.number:
                held = _rolled_back(held, record, models)
            counted.take(name, record)
        for step, behind_gap in counted.completed():
            diagnosis, advice = (said_at(step[0], beside[kind]) for kind in BESIDE)
            if held is not None:
                yield held
            before = _version_after(held, begin)
            held = RecordedStep(*step, diagnosis, advice, behind_gap=behind_gap)
            version = held.adaptation.model_version
            if held.model is None and before not in (None, version):
                held = replace(held, model=models.get(version) or _of_version(bag, version))
    if held is not None:
        yield held


def _version_after(step: RecordedStep | None, begin: tuple[int, int]) -> int | None:
    """The version in force, None where it is not known; a run begins with version 0."""
    if step is None:
        return 0 if begin == (0, 0) else None
    return step.adaptation.model_version


def _of_version(bag: Bag, version: int) -> ModelRecord | None:
    """The last recorded one, wherever it is."""
    found = None
    for model in bag.rare("model"):
        found = model if model.version == version else found
    return found


class _Counted:
    """Steps under way, by the numbers of a counter and of that which may have begun anew.

    A step whose experiment is not recorded holds up none: each topic keeps its order, so that it
    never comes once a later one is there. It came while the recorder was down.

    Args:
        models: those that were recorded last, by version; may change.
        compared: whether a step has a yardstick.
    """

    def __init__(self, models: Mapping[int, ModelRecord], compared: bool) -> None:
        self._models, self._compared = models, compared
        self._done = 0
        self._starts: dict[int, float] = {}  # of the last steps that were completed
        self._open: dict[int, _Open] = {}
        self._anew: dict[int, _Open] = {}  # of numbers that are done, at another time
        self._left_out = False  # whether one that had begun was, since the last complete one

    def take(self, name: str, record: Any) -> None:
        """Take in what is said of an experiment."""
        number = record.number
        if number > self._done:
            _take(self._open.setdefault(number, _Open()), name, record)
            return
        start = getattr(record, "start", None)
        if start is not None and self._starts.get(number) != start:
            _take(self._anew.setdefault(number, _Open()), name, record)
            forget_oldest(self._anew, 2 * WINDOW)
        elif start is None and number in self._anew:
            _take(self._anew[number], name, record)

    def completed(self) -> Iterator[tuple[_Complete, bool]]:
        """Steps that are complete by now, and whether others before them are left out for good."""
        yield from self._in_turn()
        # Each topic keeps its order: what was under way before such a step is not completed later.
        if any(self._complete(step) for step in self._anew.values()):
            self._left_out |= any(step.begun for step in self._open.values())
            self._open, self._anew, self._done = self._anew, {}, 0
            yield from self._in_turn()

    def _in_turn(self) -> Iterator[tuple[_Complete, bool]]:
        for number in sorted(self._open):
            step = self._complete(self._open[number])
            if step is not None:
                self._done = number
                self._starts[number] = step[0].start
                forget_oldest(self._starts, 2 * WINDOW)
                del self._open[number]
                for earlier in [n for n in self._open if n < number]:
                    self._left_out |= self._open.pop(earlier).begun
                left_out, self._left_out = self._left_out, False
                yield step, left_out
            elif self._may_come(self._open[number]) and len(self._open) <= WINDOW:
                break

    def _may_come(self, step: _Open) -> bool:
        """Whether it is under way, and its experiment is not one that the recorder missed."""
        return step.begun and bool(step.experiments)

    def _complete(self, step: _Open) -> _Complete | None:
        experiment, adaptation = step.experiment, step.adaptation
        if experiment is None or step.prediction is None or step.signal is None:
            return None
        if adaptation is None or (self._compared and not step.original):
            return None
        if adaptation.action is not Action.ADAPTED:
            return experiment, step.prediction, step.signal, adaptation, None
        model = self._models.get(adaptation.model_version)
        if model is None:
            return None
        return experiment, step.prediction, step.signal, adaptation, model


def _rolled_back(
    step: RecordedStep, told: Adaptation, models: dict[int, ModelRecord]
) -> RecordedStep:
    """The step as a rollback left it, if that is what was told."""
    model = models.get(told.model_version)
    if ROLLED_BACK not in told.details or model is None:
        return step
    return replace(step, adaptation=told, model=model)


Said = dict[int, list[tuple[float, Any]]]


def said_beside(bag: Bag, name: str, begin: tuple[int, int] = (0, 0)) -> Said:
    """Records of statuses by the number of their experiment, each with its stamp [s], 0 for none.

    They may come long after their step, and of several experiments that have the number.
    """
    topic = bag.topic(name)
    if topic is None:
        return {}
    whole = begin == (0, 0)
    raws = bag.storage.picked([topic]) if whole else bag.messages(name, begin=begin)
    found: Said = {}
    for raw, record in bag.usable(raws):
        _, stamp = said_of(raw.topic, raw.kind, raw.data) or (0, 0.0)
        found.setdefault(record.experiment, []).append((stamp, record))
    return found


def said_at(experiment: Experiment, records: Said) -> Any:
    """What was said last of an experiment, and not of another one of its number."""
    said = reversed(records.get(experiment.number, ()))
    return next(
        (record for stamp, record in said if not stamp or agree(stamp, experiment.end)), None
    )


def _messages(bag: Bag, begin: tuple[int, int]) -> Iterator[tuple[str, Recorded]]:
    """Records by topic; of the yardstick, which nothing is computed from, what it is about."""
    for index, raw in enumerate(bag.messages(*LOOP, YARDSTICK, begin=begin), start=1):
        name = raw.topic.rpartition("/")[2]
        if name == YARDSTICK:
            about = said_of(raw.topic, raw.kind, raw.data)
            if about is not None:
                yield name, _Compared(*about)
            continue
        try:
            record = bag.decoded(raw, index)
        except BadInput:
            continue  # every node refused it when it came, and went on
        assert isinstance(record, Experiment | Prediction | Signal | Adaptation | ModelRecord)
        yield name, record


def _take(step: _Open, name: str, record: Recorded) -> None:
    if isinstance(record, Experiment):
        step.experiments.append(record)
    elif isinstance(record, _Compared):
        step.original = True
    elif getattr(step, name) is None:
        setattr(step, name, record)
