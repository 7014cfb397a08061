"""The loop: predict, detect, adapt, in this order, once per experiment.

The three stages are what the twin, detector and adaptor nodes call, one each; `Twin.step` calls all
three. Nothing else iterates over experiments and adapts, so that `ldt run`, `ldt replay`, a study
and the node graph give the same numbers on the same experiments.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Self

import numpy as np

import msgs_config
from ldt_core.base.bounded import forget_oldest
from ldt_core.base.errors import (
    ArgumentTypeError,
    ExperimentError,
    RecordingError,
    RepeatedExperiment,
    described,
)
from ldt_core.base.experiment import Experiment, Prediction, Signal, Step
from ldt_core.base.settings import resolve
from ldt_core.detectors import as_detector, build_detector
from ldt_core.detectors.base import Detector
from ldt_core.machine.machine_file import Machine
from ldt_core.models import build_model, restore_model
from ldt_core.models.base import Model
from ldt_core.models.physics import PhysicsModel
from ldt_core.twin.adaptor import Adaptor
from ldt_core.twin.memory import Memory
from ldt_core.twin.stage import WINDOW, Archive, RecordedStep, Stage

if TYPE_CHECKING:
    from ldt_core.detectors.foreign import Updatable
    from ldt_core.twin.advisor import Advisor
    from ldt_core.twin.diagnoser import Diagnoser

#: Of the parameters that make a twin (`parameters.yaml`).
GROUPS = ("model", "detector", "adaptor", "diagnosis", "advice")
#: Samples of the idle experiment; compiled code is loaded whatever the length.
WARM_UP_SAMPLES = 3


class Predictor:
    """Stage 1: the present model and the original one predict.

    Args:
        machine: the machine as it is known beforehand.
        model: the model to begin with.
    """

    def __init__(self, machine: Machine, model: Model) -> None:
        self.machine = machine
        self.model = model
        self.original = PhysicsModel(machine)
        #: Number of the experiment predicted last; None before the first.
        self.last: int | None = None
        self._starts: dict[int, float] = {}  # of the last ones

    def warm_up(self) -> None:
        """Predict a short experiment that is nobody's, so that the first real one is not late."""
        rest = np.zeros(WARM_UP_SAMPLES)
        idle = Experiment(1, 0.0, self.machine.sample_period, rest, rest)
        self.model.predict(idle)
        self.original.predict(idle)

    def predict(self, experiment: Experiment) -> Prediction:
        """Free run of the present model.

        Raises:
            ExperimentError: the machine cannot have made this experiment, or its number is not
                above the last one's (a duplicate would be learned from twice).
            RepeatedExperiment: it is one of the last ones again.
        """
        self.machine.check(experiment)
        if self.last is not None and experiment.number <= self.last:
            known = self._starts.get(experiment.number) == experiment.start
            raise out_of_order(experiment, self.last, known)
        prediction = self.model.predict(experiment)
        self._took(experiment)
        return prediction

    def _took(self, experiment: Experiment) -> None:
        self.last = experiment.number
        self._starts[experiment.number] = experiment.start
        forget_oldest(self._starts, WINDOW)

    def recall(self, step: RecordedStep) -> None:
        """Take note of the experiment of a recorded step; the model is set by who restores it."""
        self._took(step.experiment)

    @property
    def starts(self) -> dict[int, float]:
        """Number and start [s since the epoch] of the last experiments that were taken."""
        return dict(self._starts)


class DetectorStage:
    """Stage 2: the detector compares prediction and measurement.

    Args:
        name: the detector's name in the signal.
        detector: fresh or restored.
    """

    def __init__(self, name: str, detector: Detector) -> None:
        self.name = name
        self.detector = detector

    def step(self, experiment: Experiment, prediction: Prediction) -> Signal:
        """The signal for one experiment.

        Raises:
            ExperimentError: experiment and prediction do not belong together.
        """
        self._update(experiment, prediction)
        statistics = dict(self.detector.statistics)
        statistics.pop("max_error", None)  # every signal has it
        return Signal(
            experiment.number,
            self.detector.signal,
            self.name,
            prediction.model_version,
            prediction.max_error(experiment),
            statistics,
        )

    def recall(self, step: RecordedStep) -> None:
        """Update the detector as in a recorded step.

        Raises:
            RecordingError: this detector answers otherwise than the recorded one.
        """
        self._update(step.experiment, step.prediction)
        recorded, answer = step.signal.level, self.detector.signal
        if step.signal.detector != self.name or answer is not recorded:
            raise RecordingError(
                f"signal of experiment {step.experiment.number}",
                f"{recorded.word!r} by the detector {step.signal.detector}, as recorded",
                f"{answer.word!r} by {self.name}",
            )

    def state(self) -> dict[str, Any] | None:
        """The detector's state; None where that may not be all of it (`Detector.resumable`)."""
        own = vars(type(self.detector)).get("resumable", False)
        return self.detector.state() if own else None

    def return_to(self, state: Mapping[str, Any], archive: Archive) -> None:
        """Restore the detector.

        Raises:
            OptionError: no state of this detector, which then has seen nothing.
        """
        self.detector.restore(state)

    def _update(self, experiment: Experiment, prediction: Prediction) -> None:
        self.detector.update(prediction.residual(experiment), prediction.speed_std)


class Twin:
    """A learning twin: model, detector, adaptor and memory.

    Args:
        machine: the machine as it is known beforehand, its name or its file.
        model: name, `path/to/file.py:Name`, class, or a model to begin with. "auto" is the best
            that there is: at present `diagnosed` with cause `auto`, which takes its time when the
            machine changes, as it then diagnoses why.
        detector: name, `path/to/file.py:Name`, class, or an object, of which a copy is used: a
            `Detector`, or one with river's `update(x)` and `drift_detected`, which is fed with the
            maximum error of each experiment [rad/s]. None takes the default of `ldt run`.
        settings: further options of `ldt run` about model, detector, adaptor, diagnosis and advice,
            by their names in Python (`error_threshold=0.5`).

    Raises:
        OptionError: an unknown model, detector or setting, or arguments that they refuse.
        MachineFileError: no such machine, or a file that cannot be used.
        ArgumentTypeError: an argument of another kind.
    """

    def __init__(
        self,
        machine: Machine | str | os.PathLike[str],
        model: str | Model | type[Model] = "auto",
        detector: str | Detector | type[Detector] | Updatable | DetectorStage | None = None,
        **settings: Any,
    ) -> None:
        known = Machine(machine)
        by_name = {"model": model, "detector": detector}
        named = {name: given for name, given in by_name.items() if isinstance(given, str)}
        self.settings: Mapping[str, Any] = resolve({**settings, **named}, *GROUPS)
        first = build_model(model, known, self.settings)
        self.predictor = Predictor(known, first)
        self.detector = as_detector_stage(detector, self.settings)
        self.adaptor = build_adaptor(first, self.settings)
        # A model that asks for diagnoses gets them in the adaptor; one machine needs no two.
        asked = self.settings["diagnose"] and not first.asks_for_diagnosis
        self.diagnoser = build_diagnoser(known, self.settings) if asked else None
        self.advisor = build_advisor(known, self.settings) if self.settings["advice"] else None

    @classmethod
    def from_settings(
        cls, machine: Machine, settings: Mapping[str, Any], detector: DetectorStage | None = None
    ) -> Self:
        """The twin that the parameters of a run describe (`parameters.yaml`).

        Args:
            machine: the machine as it is known beforehand.
            settings: with those of `GROUPS`, the defaults where they are missing.
            detector: stage 2, where it is not the detector of the settings.

        Raises:
            OptionError: an unknown model or detector, or arguments that they refuse.
        """
        given = {n: settings[n] for n in msgs_config.parameters(*GROUPS) if n in settings}
        twin = cls(machine, **({**given, "detector": detector} if detector else given))
        twin.settings = settings
        return twin

    def __repr__(self) -> str:
        machine, model = self.predictor.machine.name, self.model
        return f"Twin({machine!r}, {model.kind} version {model.version}, {self.detector.name})"

    @property
    def model(self) -> Model:
        """The present model."""
        return self.predictor.model

    @property
    def trouble(self) -> str:
        """Why the last diagnosis came to nothing; empty when it came to something."""
        diagnoser = self.diagnoser or self.adaptor.diagnoser
        return diagnoser.trouble if diagnoser else ""

    def step(self, experiment: Experiment) -> Step:
        """One turn of the loop.

        Raises:
            ExperimentError: as `Predictor.predict`; the twin is as before then.
            ArgumentTypeError: no experiment at all.
        """
        if not isinstance(experiment, Experiment):
            raise ArgumentTypeError("experiment", "an ldt.Experiment", described(experiment))
        prediction = self.predictor.predict(experiment)
        original = self.predictor.original.predict(experiment)
        signal = self.detector.step(experiment, prediction)
        adaptation, model = self.adaptor.step(experiment, signal)
        diagnosis = self.adaptor.diagnosis
        if self.diagnoser is not None:
            diagnosis = self.diagnoser.step(experiment, signal)
        changed = model.version != self.model.version
        self.predictor.model = model
        record = model.record() if changed else None
        advice = None
        if self.advisor is not None:
            if diagnosis is not None:
                self.advisor.informed(diagnosis)
            advice = self.advisor.step(experiment, model.record())
        return Step(experiment, prediction, original, signal, adaptation, record, diagnosis, advice)

    @property
    def stages(self) -> dict[str, Stage]:
        """The stages that keep checkpoints, by the role of their node."""
        found: dict[str, Stage | None] = {
            "detector": self.detector,
            "adaptor": self.adaptor,
            "diagnoser": self.diagnoser,
            "advisor": self.advisor,
        }
        return {name: stage for name, stage in found.items() if stage is not None}

    def steps(
        self,
        experiments: Iterable[Experiment],
        rejected: Callable[[ExperimentError], None] = lambda error: None,
    ) -> Iterator[Step]:
        """The loop over a stream of experiments.

        Args:
            experiments: in the order of their numbers.
            rejected: told of each experiment that cannot be used, or that comes again; the loop
                goes on with the next.
        """
        for experiment in experiments:
            try:
                step = self.step(experiment)
            except ExperimentError as error:
                rejected(error)
            else:
                yield step


def out_of_order(experiment: Experiment, last: int, known: bool) -> ExperimentError:
    """Why an experiment is not taken whose number is not above the last one's.

    Args:
        experiment: in question.
        last: number of the last one taken.
        known: whether it has been taken itself.
    """
    kind = RepeatedExperiment if known else ExperimentError
    return kind(f"experiment {experiment.number}", f"a number above {last}", experiment.number)


def as_detector_stage(detector: object, settings: Mapping[str, Any]) -> DetectorStage:
    """Stage 2 of a detector: name, class or object; None takes that of the settings."""
    if isinstance(detector, DetectorStage):
        return detector
    if detector is None or isinstance(detector, str):
        return build_detector_stage(settings)
    built = (
        build_detector(detector, settings)
        if isinstance(detector, type) and issubclass(detector, Detector)
        else as_detector(detector)
    )
    return DetectorStage(getattr(built, "name", type(built).__name__), built)


def build_detector_stage(settings: Mapping[str, Any]) -> DetectorStage:
    """Stage 2 from the parameters of the group detector."""
    return DetectorStage(settings["detector"], build_detector(settings["detector"], settings))


def build_diagnoser(machine: Machine, settings: Mapping[str, Any]) -> Diagnoser:
    """The diagnosis beside the loop from the parameters of the group diagnosis."""
    from ldt_core.twin.diagnoser import Diagnoser  # few runs need it, and it takes time to load

    return Diagnoser(machine, settings)


def build_advisor(machine: Machine, settings: Mapping[str, Any]) -> Advisor:
    """The advice to people beside the loop from the parameters of the group advice."""
    from ldt_core.twin.advisor import Advisor  # as above

    return Advisor(machine, settings)


def build_adaptor(model: Model, settings: Mapping[str, Any]) -> Adaptor:
    """Stage 3 from the parameters of the groups adaptor and diagnosis."""
    memory = Memory(settings["memory_limit"], settings["history"])
    how = {name: settings[name] for name in ("gate", "holdout", "data", "sensor_check")}
    diagnoser = build_diagnoser(model.machine, settings) if model.asks_for_diagnosis else None
    restore = partial(restore_model, machine=model.machine, settings=settings)
    return Adaptor(model, memory, **how, diagnoser=diagnoser, restore=restore)
