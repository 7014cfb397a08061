"""What a recording has of one machine's run, read from its beginning or near an experiment."""

from __future__ import annotations

import contextlib
import itertools
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ldt_core.base.bounded import forget_oldest
from ldt_core.base.errors import BadInput, LdtError, RecordingError
from ldt_core.base.experiment import Action, Adaptation, Experiment, ModelRecord, Prediction, Signal
from ldt_core.machine.machine_file import Machine
from ldt_core.recording.bag import Bag
from ldt_core.recording.experiment_numbers import number_of
from ldt_core.recording.step_search import ANCHOR, StepSearch
from ldt_core.recording.storage import Storage
from ldt_core.twin.adaptor import ROLLED_BACK
from ldt_core.twin.stage import WINDOW, RecordedStep

#: In place of an experiment's number: the last one, whichever it is.
END = sys.maxsize
#: Ranges of numbers, which may have gaps, that are searched for `WINDOW` steps.
REACHES = (WINDOW, 8 * WINDOW)
#: Time after which a recording that could not be read is tried again [s].
MENDING = 0.3

#: Topics of which a step consists.
LOOP = ("experiment", "prediction", "signal", "adaptation", "model")
#: Topic from which nothing is computed.
YARDSTICK = "original_prediction"
#: Topics whose records may come long after their step.
BESIDE = ("diagnosis", "advice")
Recorded = Experiment | Prediction | Signal | Adaptation | ModelRecord


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

    def steps(self, around: int = 0) -> Iterator[RecordedStep]:
        """Complete steps; none where nothing of the machine was recorded yet.

        Args:
            around: number of an experiment, or `END`. Reading begins at least `WINDOW` steps before
                it, which takes as long in a long recording as in a short one. Where that place
                cannot be found, all steps are read.
        """
        tail = self._tail(around) if around > WINDOW else None
        if tail is not None:
            yield from tail
            return
        bag = self.bag()
        if bag is not None:
            yield from complete_steps(bag, self.machine)

    def last_of(self, topic: str, around: int = 0) -> int:
        """The last experiment that a record of a topic is about or is, 0 if there is none.

        Args:
            around: as of `steps`; what was recorded before that place does not count.
        """
        if around > WINDOW:
            with contextlib.suppress(LdtError, OSError):
                return self._last_around(topic, around)
        bag = self.bag()
        return last_in(bag, topic) if bag is not None and bag.topic(topic) else 0

    def _tail(self, around: int) -> Iterator[RecordedStep] | None:
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

    def _steps_around(self, around: int) -> Iterator[RecordedStep] | None:
        bag = self.bag(listed=True)
        if bag is None or bag.topic(ANCHOR) is None:
            return None
        search = StepSearch(bag)
        if around == END:
            last = search.near_end()
            around = last.number if last else 0
        for reach in REACHES:
            done = around - reach - 1
            if done <= WINDOW:
                return None
            begin = search.begin(search.of_number(done - WINDOW))
            steps = complete_steps(bag, self.machine, begin, done)
            before = list(itertools.islice(steps, WINDOW))
            if len(before) == WINDOW and before[-1].number < around:
                return itertools.chain(before, steps)
        return None

    def _last_around(self, topic: str, around: int) -> int:
        bag = self.bag(listed=True)
        if bag is None:
            return 0
        search = StepSearch(bag)
        last = search.near_end()
        if last is None:
            raise RecordingError(bag.path, "steps", "none")
        number = min(around, last.number)
        if bag.topic(topic) is None:
            return 0
        begin = search.begin(search.of_number(number - WINDOW))
        raws = bag.messages(topic, begin=begin)
        return max((number_of(raw.topic, raw.kind, raw.data) or 0 for raw in raws), default=0)


def last_in(bag: Bag, topic: str) -> int:
    """The last experiment that a record of a topic is about or is, in a recording that has it."""
    raws = bag.storage.picked([bag.topic(topic) or ""])
    return max((number_of(raw.topic, raw.kind, raw.data) or 0 for raw in raws), default=0)


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
    bag: Bag, machine: Machine, begin: tuple[int, int] = (0, 0), done: int = 0
) -> Iterator[RecordedStep]:
    """Complete steps of a recording in the order of their numbers, up to where it ends.

    A step is complete once its experiment, prediction, signal, adaptation and the model that goes
    on are recorded. What comes after the last one is done again, and comes out the same.

    A node that was started again may have sent its messages in another order, and some twice: the
    first of each counts. A step that stays incomplete while `WINDOW` later ones come is left out.
    Where somebody has rolled the twin back after a step, that is how the step ended. A message that
    is none of its topic's is left out, as the nodes did when it came.

    Args:
        bag: as `read_bag` opened it; may be one that is being written.
        machine: what it cannot have made was refused, whatever its number.
        begin: file and byte before which nothing is read (`Storage.messages`).
        done: the steps up to this number are left out.
    """
    beside = {name: _beside(bag, name, begin) for name in BESIDE}
    models: dict[int, ModelRecord] = {}
    open_: dict[int, _Open] = {}
    held: RecordedStep | None = None  # the last step, after which a rollback may come
    compared = bag.topic(YARDSTICK) is not None
    for name, record in _messages(bag, begin, done):
        if isinstance(record, ModelRecord):
            models[record.version] = record
            forget_oldest(models, 2 * WINDOW)
        elif isinstance(record, int):
            if record > done:
                open_.setdefault(record, _Open()).original = True
        else:
            number = record.experiment if isinstance(record, Signal | Adaptation) else record.number
            if isinstance(record, Adaptation) and held and number == held.experiment.number:
                held = _rolled_back(held, record, models)
            refused = isinstance(record, Experiment) and not machine.may_have_made(record)
            if number <= done or refused:
                continue
            _take(open_.setdefault(number, _Open()), name, record)
        for number in sorted(open_):
            step = _complete(open_[number], models, compared)
            if step is not None:
                done = number
                for earlier in [n for n in open_ if n <= done]:
                    del open_[earlier]
                diagnosis, advice = (beside.get(kind, {}).get(number) for kind in BESIDE)
                if held is not None:
                    yield held
                held = RecordedStep(*step, diagnosis, advice)
            elif open_[number].begun and len(open_) <= WINDOW:
                break
    if held is not None:
        yield held


def _rolled_back(
    step: RecordedStep, told: Adaptation, models: dict[int, ModelRecord]
) -> RecordedStep:
    """The step as a rollback left it, if that is what was told."""
    model = models.get(told.model_version)
    if ROLLED_BACK not in told.details or model is None:
        return step
    return replace(step, adaptation=told, model=model)


def _beside(bag: Bag, name: str, begin: tuple[int, int]) -> dict[int, Any]:
    """Records that may come long after their step, by experiment."""
    if begin == (0, 0):
        return {record.experiment: record for record in bag.rare(name)}
    found: dict[int, Any] = {}
    for _, record in bag.usable(bag.messages(name, begin=begin)):
        found[record.experiment] = record
    return found


def _messages(bag: Bag, begin: tuple[int, int], done: int) -> Iterator[tuple[str, Recorded | int]]:
    """Records by topic; of the yardstick, which nothing is computed from, the number alone."""
    for index, raw in enumerate(bag.messages(*LOOP, YARDSTICK, begin=begin), start=1):
        name = raw.topic.rpartition("/")[2]
        number = number_of(raw.topic, raw.kind, raw.data)
        if number is not None and number < done:
            continue
        if name == YARDSTICK:
            yield name, number or 0
            continue
        try:
            record = bag.decoded(raw, index)
        except BadInput:
            continue  # every node refused it when it came, and went on
        assert isinstance(record, Recorded)  # of the topics in LOOP
        yield name, record


def _take(step: _Open, name: str, record: Experiment | Prediction | Signal | Adaptation) -> None:
    if isinstance(record, Experiment):
        step.experiments.append(record)
    elif getattr(step, name) is None:
        setattr(step, name, record)


def _complete(
    step: _Open, models: dict[int, ModelRecord], compared: bool
) -> tuple[Experiment, Prediction, Signal, Adaptation, ModelRecord | None] | None:
    experiment, adaptation = step.experiment, step.adaptation
    if experiment is None or step.prediction is None or step.signal is None or adaptation is None:
        return None
    if compared and not step.original:
        return None
    if adaptation.action is not Action.ADAPTED:
        return experiment, step.prediction, step.signal, adaptation, None
    model = models.get(adaptation.model_version)
    if model is None:
        return None
    return experiment, step.prediction, step.signal, adaptation, model
