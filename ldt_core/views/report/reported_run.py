"""What a recording tells of a run, step by step."""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field, replace
from pathlib import Path

from ldt_core.base.errors import RecordingError
from ldt_core.base.experiment import DiagnosisRecord, Experiment, ModelRecord, Signal
from ldt_core.base.metrics import Summary
from ldt_core.recording.bag import Bag, read_twin_run
from ldt_core.recording.codec import Record
from ldt_core.recording.health import Health, inspect
from ldt_core.views.packed_samples import room
from ldt_core.views.step_order import StepOrder
from ldt_core.views.step_view import StepCollector, StepView

#: Samples of experiments that are held whole: five rows of them take 80 MB.
MOST_HELD = 2_000_000
CHANNELS = 6  # that an experiment has at most: time, voltage, three speeds, deviation


Ends = tuple[float, float]  # the least and the most


@dataclass
class Extent:
    """What the experiments of a run cover.

    Attributes:
        begin: the first start, by the clock of then [s since the epoch].
        end: the last end.
        samples, period, duration, voltage, speed: the least and the most of all experiments; of
            periods and durations in s, voltage in V, speed in rad/s.
    """

    begin: float
    end: float
    samples: Ends
    period: Ends
    duration: Ends
    voltage: Ends
    speed: Ends

    @classmethod
    def of(cls, e: Experiment) -> Extent:
        """Of one experiment."""
        voltage, speed = ((float(row.min()), float(row.max())) for row in (e.voltage, e.speed))
        samples, period, duration = ((v, v) for v in (float(len(e)), e.period, e.duration))
        return cls(e.start, e.end, samples, period, duration, voltage, speed)

    def take(self, e: Experiment) -> None:
        """Take in one more."""
        other = Extent.of(e)
        self.begin, self.end = min(self.begin, other.begin), max(self.end, other.end)
        for name in ("samples", "period", "duration", "voltage", "speed"):
            (least, most), (low, high) = getattr(self, name), getattr(other, name)
            setattr(self, name, (min(least, low), max(most, high)))


@dataclass
class ReportedRun:
    """A recorded run.

    Attributes:
        steps: those that were predicted and judged, in the order of `StepOrder`.
        models: in the order in which they were sent.
        diagnoses: in their order.
        notes: what a person should know of the numbers.
    """

    name: str
    bag: Bag
    health: Health
    steps: list[StepView] = field(default_factory=list)
    signals: list[Signal] = field(default_factory=list)
    extent: Extent | None = None
    models: list[ModelRecord] = field(default_factory=list)
    diagnoses: list[DiagnosisRecord] = field(default_factory=list)
    summary: Summary = field(default_factory=Summary)
    notes: list[str] = field(default_factory=list)

    @property
    def worst_first(self) -> list[int]:
        """Indices of the steps by the learning twin's error, the largest first."""
        return sorted(range(len(self.signals)), key=lambda i: -self.signals[i].max_error)

    @property
    def thinned(self) -> int:
        """Experiments of which not all samples are in the page."""
        packs = [step.packed for step in self.steps]
        return sum(p is None or p.kept < p.of for p in packs)


def read_run(recording: str | Path, namespace: str = "") -> ReportedRun:
    """Read a run with the samples that a page has room for.

    Raises:
        RecordingError: no recording of a run.
        ExperimentError, ModelError: a message in it that is no such record.
    """
    bag = read_twin_run(recording, namespace)
    topic = bag.topic("signal") or ""
    most, shown = room(max(1, bag.storage.counts([topic])[topic]), CHANNELS)
    collector = StepCollector(bag.topic("original_prediction") is not None)
    order = StepOrder()
    extent: Extent | None = None
    worst = _Worst(shown, most)
    models: list[tuple[int, ModelRecord]] = []  # how often the counter had begun anew
    diagnoses: list[tuple[int, DiagnosisRecord]] = []

    def put(step: StepView) -> None:
        nonlocal extent
        assert step.experiment is not None  # of a step that is whole
        order.put(step)
        if extent is None:
            extent = Extent.of(step.experiment)
        extent.take(step.experiment)
        worst.take(step)

    def seen(name: str, record: Record) -> None:
        if isinstance(record, ModelRecord):
            models.append((order.turn, record))
        elif isinstance(record, DiagnosisRecord):
            diagnoses.append((order.turn, record))
        elif (step := collector.take(name, record)) is not None:
            put(step)

    run = ReportedRun(bag.path.resolve().name, bag, inspect(bag, seen))
    for step in collector.rest():
        put(step)
    worst.settle()
    run.steps, run.extent = order.steps(), extent
    if not run.steps:
        raise RecordingError(bag.path, "experiments that a twin has predicted and judged", "none")
    for turn, model in models:
        learned = tuple(order.shown(n, turn) for n in model.trained_on)
        run.models.append(replace(model, trained_on=learned))
    for turn, said in diagnoses:
        run.diagnoses.append(replace(said, experiment=order.shown(said.experiment, turn)))
    run.notes = order.notes
    for step in run.steps:
        assert step.signal is not None  # or it would be no step
        run.signals.append(step.signal)
        run.summary.add_signal(step.signal)
        if step.original_error is not None:
            run.summary.add_original(step.original_error)
        if step.adaptation is not None:
            run.summary.add_adaptation(step.adaptation)
    run.summary.diagnoses.extend(run.diagnoses)
    return run


class _Worst:
    """The steps with the largest errors, which keep their samples; all others let them go.

    Whole samples are held as long as they are few: of those that come, most leave again.

    Args:
        shown: steps.
        most: samples of each in the end.
    """

    def __init__(self, shown: int, most: int) -> None:
        self._shown, self._most = shown, most
        self._kept: list[tuple[float, int, StepView]] = []  # a heap, the least error first
        self._whole = self._count = 0  # samples that are held whole; steps that have come

    def take(self, step: StepView) -> None:
        """Take in one that is whole."""
        assert step.experiment is not None
        assert step.signal is not None
        self._count += 1
        entry = step.signal.max_error, -self._count, step  # of equals the first one stays
        self._whole += len(step.experiment)
        if len(self._kept) < self._shown:
            heapq.heappush(self._kept, entry)
        else:
            _, _, left = heapq.heappushpop(self._kept, entry)
            self._whole -= len(left.experiment) if left.experiment is not None else 0
            left.packed = None
            left.settle(None)
        if self._whole > MOST_HELD:
            self.settle()

    def settle(self) -> None:
        """Thin what is held."""
        for _, _, step in self._kept:
            step.settle(self._most)
        self._whole = 0
