"""What a recording tells of a run, experiment by experiment."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from ldt_core.base.errors import RecordingError
from ldt_core.base.experiment import (
    Adaptation,
    DiagnosisRecord,
    Experiment,
    ModelRecord,
    Prediction,
    Signal,
)
from ldt_core.base.metrics import Summary
from ldt_core.recording.bag import Bag, read_twin_run
from ldt_core.recording.health import Health, inspect
from ldt_core.views.report.samples import Packed, pack, room

CHANNELS = 6  # that an experiment has at most: time, voltage, three speeds, deviation


@dataclass
class Turn:
    """One experiment and what the twin made of it.

    Attributes:
        experiment: its number.
        start: [s since the epoch].
        end: [s since the epoch].
        period: of its samples [s].
        length: samples.
        voltage: (least, most) [V].
        speed: (least, most) [rad/s].
        signal: of the detector.
        original: maximum error of the model that never learns [rad/s], None when not recorded.
        adaptation: None where the run ended before.
        samples: None where there is no room.
    """

    experiment: int
    start: float
    end: float
    period: float
    length: int
    voltage: tuple[float, float]
    speed: tuple[float, float]
    signal: Signal
    original: float | None
    adaptation: Adaptation | None
    samples: Packed | None


@dataclass
class Run:
    """A recorded run.

    Attributes:
        name: of the recording.
        bag: the recording.
        health: of the recording.
        turns: by number, those that were predicted and judged.
        models: in the order in which they were sent.
        diagnoses: in their order.
        summary: figures of all turns.
    """

    name: str
    bag: Bag
    health: Health
    turns: list[Turn] = field(default_factory=list)
    models: list[ModelRecord] = field(default_factory=list)
    diagnoses: list[DiagnosisRecord] = field(default_factory=list)
    summary: Summary = field(default_factory=Summary)

    @property
    def worst_first(self) -> list[int]:
        """Indices of the turns by the learning twin's error, the largest first."""
        errors = [turn.signal.max_error for turn in self.turns]
        return sorted(range(len(errors)), key=lambda i: -errors[i])

    @property
    def thinned(self) -> int:
        """Experiments of which not all samples are in the page."""
        packs = [turn.samples for turn in self.turns]
        return sum(p is None or p.kept < p.of for p in packs)


def read_run(recording: str | Path, namespace: str = "") -> Run:
    """Read a run with the samples that a page has room for.

    Args:
        recording: of `ldt up`, `run` or `replay`.
        namespace: of the machine, when there are several.

    Raises:
        RecordingError: no recording of a run.
        ExperimentError, ModelError: a message in it that is no such record.
    """
    bag = read_twin_run(recording, namespace)
    signals = {s.experiment: s for s in bag.records("signal")}
    run = Run(bag.path.resolve().name, bag, inspect(bag))
    run.models = list(bag.records("model"))
    run.diagnoses = list(bag.records("diagnosis"))
    _read_turns(run, signals)
    if not run.turns:
        raise RecordingError(bag.path, "experiments that a twin has predicted and judged", "none")
    _sum_up(run)
    return run


def _read_turns(run: Run, signals: dict[int, Signal]) -> None:
    adaptations = {a.experiment: a for a in run.bag.records("adaptation")}
    predictions = {p.number: p for p in run.bag.records("prediction")}
    originals = {p.number: p for p in run.bag.records("original_prediction")}
    most, shown = room(max(1, len(signals)), CHANNELS)
    worst = sorted(signals.values(), key=lambda s: -s.max_error)[:shown]
    drawn = {s.experiment for s in worst}
    found: dict[int, Turn] = {}
    for experiment in run.bag.experiments():
        number = experiment.number
        prediction, signal = predictions.get(number), signals.get(number)
        if prediction is None or signal is None or not _same(prediction, experiment):
            continue
        original = originals.get(number)
        if original is not None and not _same(original, experiment):
            original = None
        found[number] = Turn(
            number,
            experiment.start,
            experiment.end,
            experiment.period,
            len(experiment),
            (float(experiment.voltage.min()), float(experiment.voltage.max())),
            (float(experiment.speed.min()), float(experiment.speed.max())),
            signal,
            None if original is None else original.max_error(experiment),
            adaptations.get(number),
            pack(experiment, prediction, original, most) if number in drawn else None,
        )
    run.turns = [found[number] for number in sorted(found)]


def _same(prediction: Prediction, experiment: Experiment) -> bool:
    """A number may come twice: the experiment that was predicted has the prediction's start."""
    return prediction.start == experiment.start and len(prediction) == len(experiment)


def _sum_up(run: Run) -> None:
    for turn in run.turns:
        run.summary.add_signal(turn.signal)
        if turn.original is not None:
            run.summary.add_original(turn.original)
        if turn.adaptation is not None:
            run.summary.add_adaptation(turn.adaptation)
    for diagnosis in run.diagnoses:
        run.summary.diagnoses.append(diagnosis)
