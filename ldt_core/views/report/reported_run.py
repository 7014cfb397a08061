"""What a recording tells of a run, step by step."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from ldt_core.base.errors import RecordingError
from ldt_core.base.experiment import DiagnosisRecord, Experiment, ModelRecord, Signal
from ldt_core.base.metrics import Summary
from ldt_core.recording.bag import Bag, read_twin_run
from ldt_core.recording.health import Health, inspect
from ldt_core.views.packed_samples import room
from ldt_core.views.step_view import StepView, recorded_steps

CHANNELS = 6  # that an experiment has at most: time, voltage, three speeds, deviation


class Extent(NamedTuple):
    """What an experiment covers: times [s], samples, (least, most) of voltage [V] and speed."""

    start: float
    end: float
    period: float
    length: int
    voltage: tuple[float, float]
    speed: tuple[float, float]

    @classmethod
    def of(cls, e: Experiment) -> Extent:
        """Of an experiment."""
        voltage, speed = ((float(row.min()), float(row.max())) for row in (e.voltage, e.speed))
        return cls(e.start, e.end, e.period, len(e), voltage, speed)


@dataclass
class ReportedRun:
    """A recorded run.

    Attributes:
        steps: by number, those that were predicted and judged.
        models: in the order in which they were sent.
        diagnoses: in their order.
    """

    name: str
    bag: Bag
    health: Health
    steps: list[StepView] = field(default_factory=list)
    signals: list[Signal] = field(default_factory=list)
    extents: list[Extent] = field(default_factory=list)
    models: list[ModelRecord] = field(default_factory=list)
    diagnoses: list[DiagnosisRecord] = field(default_factory=list)
    summary: Summary = field(default_factory=Summary)

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
    signals = {s.experiment: s for s in bag.records("signal")}
    run = ReportedRun(bag.path.resolve().name, bag, inspect(bag))
    run.models = list(bag.records("model"))
    run.diagnoses = list(bag.records("diagnosis"))
    most, shown = room(max(1, len(signals)), CHANNELS)
    worst = sorted(signals.values(), key=lambda s: -s.max_error)[:shown]
    drawn = {s.experiment for s in worst}
    found: dict[int, tuple[StepView, Extent]] = {}
    for step in recorded_steps(bag, signals):
        if step.experiment is not None:
            found[step.number] = step, Extent.of(step.experiment)
            step.settle(most if step.number in drawn else None)
    if not found:
        raise RecordingError(bag.path, "experiments that a twin has predicted and judged", "none")
    numbers = sorted(found)
    run.steps, run.extents = [found[n][0] for n in numbers], [found[n][1] for n in numbers]
    run.signals = [signals[n] for n in numbers]
    for step, signal in zip(run.steps, run.signals, strict=True):
        run.summary.add_signal(signal)
        if step.original_error is not None:
            run.summary.add_original(step.original_error)
        if step.adaptation is not None:
            run.summary.add_adaptation(step.adaptation)
    run.summary.diagnoses.extend(run.diagnoses)
    return run
