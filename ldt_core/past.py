"""What a recording says of the steps of a run, from which a twin goes on where it ended.

A step is complete once its experiment, prediction, signal, adaptation and the model that goes on
are recorded. What comes after the last complete one is done again: every stage is a function of
what came before, so that it comes out the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ldt_core.adaptor import ROLLED_BACK
from ldt_core.experiment import (
    Action,
    Adaptation,
    AdviceRecord,
    DiagnosisRecord,
    Experiment,
    ModelRecord,
    Prediction,
    Signal,
)
from ldt_core.machine import Machine
from ldt_core.models import restore_model
from ldt_core.recording.bag import Bag
from ldt_core.recording.numbers import number_of
from ldt_core.recording.storage import Storage
from ldt_core.twin import WINDOW

if TYPE_CHECKING:
    from ldt_core.models.base import Model

LOOP = ("experiment", "prediction", "signal", "adaptation", "model")
YARDSTICK = "original_prediction"
BESIDE = ("diagnosis", "advice")
Recorded = Experiment | Prediction | Signal | Adaptation | ModelRecord


@dataclass(frozen=True)
class Past:
    """A complete step, as it was recorded.

    Args:
        experiment: of the step.
        prediction: by the model then in force.
        signal: of the detector.
        adaptation: what was done; after a rollback, that.
        model: adopted in this step, or by a rollback; None where the model stayed.
        diagnosis: made at this experiment, or None.
        advice: given at this experiment, or None.
    """

    experiment: Experiment
    prediction: Prediction
    signal: Signal
    adaptation: Adaptation
    model: ModelRecord | None = None
    diagnosis: DiagnosisRecord | None = None
    advice: AdviceRecord | None = None

    def restored(self, machine: Machine, settings: Mapping[str, Any]) -> Model | None:
        """The model that it brought into force; None where the one before stayed.

        Raises:
            ModelError: a recorded model that cannot be this machine's.
        """
        return None if self.model is None else restore_model(self.model, machine, settings)


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


def past_of(path: str | Path, namespace: str, machine: Machine) -> Iterator[Past]:
    """Complete steps of one machine in a recording; none where nothing of it was recorded yet.

    Args:
        path: folder of the recording, which need not exist.
        namespace: of the machine, "/" for the root.
        machine: what it cannot have made was refused, whatever its number.

    Raises:
        RecordingError: what stands there is no recording, or none that can be read.
    """
    bag = _opened(path, namespace)
    if bag is not None:
        yield from past(bag, machine)


def last_of(path: str | Path, namespace: str, topic: str) -> int:
    """The last experiment that a record of a topic is about or is, 0 if there is none.

    Raises:
        RecordingError: as `past_of`.
    """
    bag = _opened(path, namespace)
    return last_in(bag, topic) if bag is not None and bag.topic(topic) else 0


def last_in(bag: Bag, topic: str) -> int:
    """The same of a recording that is open, and has the topic."""
    raws = bag.storage.picked([bag.topic(topic) or ""])
    return max((number_of(raw.topic, raw.kind, raw.data) or 0 for raw in raws), default=0)


def _opened(path: str | Path, namespace: str) -> Bag | None:
    if not Path(path).exists():
        return None
    storage = Storage(path)
    absolute = "/" + namespace.strip("/") if namespace.strip("/") else ""
    return Bag(storage, absolute) if f"{absolute}/experiment" in storage.topics else None


def past(bag: Bag, machine: Machine) -> Iterator[Past]:
    """Complete steps of a recording in the order of their numbers, up to where it ends.

    A node that was started again may have sent its messages in another order, and some twice: the
    first of each counts. A step that stays incomplete while `WINDOW` later ones come is left out.
    Where somebody has rolled the twin back after a step, that is how the step ended.

    Args:
        bag: as `read_bag` opened it; may be one that is being written.
        machine: what it cannot have made was refused, whatever its number.

    Raises:
        RecordingError: a message that is none of the topic's.
    """
    beside = {
        name: {record.experiment: record for record in bag.rare(name)}
        for name in BESIDE
        if bag.topic(name)
    }
    models: dict[int, ModelRecord] = {}
    open_: dict[int, _Open] = {}
    done = 0
    held: Past | None = None  # the last step, after which a rollback may come
    compared = bag.topic(YARDSTICK) is not None
    for name, record in _messages(bag):
        if isinstance(record, ModelRecord):
            models[record.version] = record
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
                held = Past(*step, diagnosis, advice)
            elif open_[number].begun and len(open_) <= WINDOW:
                break
    if held is not None:
        yield held


def _rolled_back(step: Past, told: Adaptation, models: dict[int, ModelRecord]) -> Past:
    """The step as a rollback left it, if that is what was told."""
    model = models.get(told.model_version)
    if ROLLED_BACK not in told.details or model is None:
        return step
    return replace(step, adaptation=told, model=model)


def _messages(bag: Bag) -> Iterator[tuple[str, Recorded | int]]:
    """Records by topic; of the yardstick, which nothing is computed from, the number alone."""
    names = [name for name in (*LOOP, YARDSTICK) if bag.topic(name)]
    for index, raw in enumerate(bag.messages(*names), start=1):
        name = raw.topic.rpartition("/")[2]
        if name == YARDSTICK:
            yield name, number_of(raw.topic, raw.kind, raw.data) or 0
            continue
        record = bag.decoded(raw, index)
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
