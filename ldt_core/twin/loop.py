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

import msgs_config
from ldt_core.base.errors import (
    FAULTS,
    ArgumentTypeError,
    ExperimentError,
    LdtError,
    UnansweredExperiment,
    described,
    reason_of,
)
from ldt_core.base.experiment import FAILED, DiagnosisRecord, Experiment, Signal, Step
from ldt_core.base.settings import preset as preset_of
from ldt_core.base.settings import resolve
from ldt_core.detectors.base import Detector
from ldt_core.machine.machine_file import Machine
from ldt_core.models import AUTO, build_model, restore_model
from ldt_core.models.base import Model
from ldt_core.twin.adaptor import Adaptor
from ldt_core.twin.detector_stage import DetectorStage, as_detector_stage
from ldt_core.twin.memory import Memory
from ldt_core.twin.predictor import Predictor
from ldt_core.twin.stage import Stage

if TYPE_CHECKING:
    from ldt_core.detectors.foreign import Updatable
    from ldt_core.twin.advisor import Advisor
    from ldt_core.twin.diagnoser import Diagnoser

#: Of the parameters that make a twin (`parameters.yaml`).
GROUPS = ("model", "detector", "adaptor", "diagnosis", "advice")


class Twin:
    """A learning twin: model, detector, adaptor and memory.

    Args:
        machine: the machine as known beforehand, its name or its file.
        model: name, `path/to/file.py:Name`, class, or a model to start with. None is the default,
            "auto", the best choice: at every change, causes, earlier versions and flexible models
            compete (`ldt_core.twin.contest`).
        detector: name, `path/to/file.py:Name`, class, or an object, which is copied: a `Detector`,
            or one with river's `update(x)` and `drift_detected`, which gets the maximum error of
            each experiment [rad/s]. None is the default, `adequacy`.
        preset: "paper" for the paper's configuration instead of the defaults.
        settings: further options of `ldt run` for model, detector, adaptor, diagnosis and advice,
            with their Python names (`error_threshold=0.5`). `cause` may be an effect itself.

    Raises:
        OptionError: an unknown model, detector, preset or setting, or arguments that they refuse.
        MachineFileError: no such machine, or a file that cannot be used.
        ArgumentTypeError: an argument of a wrong type.
    """

    def __init__(
        self,
        machine: Machine | str | os.PathLike[str],
        model: str | Model | type[Model] | None = None,
        detector: str | Detector | type[Detector] | Updatable | DetectorStage | None = None,
        *,
        preset: str = "",
        **settings: Any,
    ) -> None:
        known = Machine(machine)
        by_name = {"model": model, "detector": detector}
        named = {name: given for name, given in by_name.items() if isinstance(given, str)}
        cause = {"cause": settings.pop("cause")} if _is_effect(settings.get("cause")) else {}
        given = {**preset_of(preset), **settings, **named}
        self.settings: Mapping[str, Any] = resolve(given, *GROUPS) | cause
        first = build_model(
            self.settings["model"] if model is None else model, known, self.settings
        )
        if model is not None and not isinstance(model, str):
            self.settings = {**self.settings, "model": first.kind}
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
            UnansweredExperiment: as there; the twin is as before then, too.
            ArgumentTypeError: no experiment at all.
        """
        if not isinstance(experiment, Experiment):
            raise ArgumentTypeError("experiment", "an ldt.Experiment", described(experiment))
        prediction = self.predictor.predict(experiment)
        original = self.predictor.predict_original(experiment)
        signal = self.detector.step(experiment, prediction)
        adaptation, model = self.adaptor.step(experiment, signal)
        diagnosis = self.adaptor.diagnosis
        if self.diagnoser is not None:
            diagnosis = self._beside(experiment, signal)
        changed = model.version != self.model.version
        self.predictor.model = model
        record = model.record() if changed else None
        advice = None
        if self.advisor is not None:
            if diagnosis is not None:
                self.advisor.informed(diagnosis)
            advice = self.advisor.step(experiment, model.record())
        return Step(experiment, prediction, original, signal, adaptation, record, diagnosis, advice)

    def _beside(self, experiment: Experiment, signal: Signal) -> DiagnosisRecord | None:
        """What a diagnosis beside the loop finds; it never ends a step."""
        assert self.diagnoser is not None
        try:
            return self.diagnoser.step(experiment, signal)
        except FAULTS as error:
            self.diagnoser.trouble = reason_of(error)
            return None

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
        rejected: Callable[[LdtError], None] = lambda error: None,
    ) -> Iterator[Step]:
        """The loop over a stream of experiments.

        Args:
            experiments: in the order of their numbers.
            rejected: told of each experiment that cannot be used, that comes again, or that is
                not answered, whatever was raised; the loop goes on with the next.
        """
        for experiment in experiments:
            try:
                step = self.step(experiment)
            except (ExperimentError, UnansweredExperiment) as error:
                rejected(error)
            except FAULTS as error:  # a fault of ours: it costs one experiment, not the run
                rejected(UnansweredExperiment(experiment.number, reason_of(error)))
            else:
                yield step


def faultless(steps: Iterable[Step]) -> Iterator[Step]:
    """The steps, for whoever computes figures of them.

    Raises:
        LdtError: detector or adaptor failed at one of them.
    """
    for step in steps:
        if step.adaptation.details.get(FAILED):
            raise LdtError(f"experiment {step.number}: {step.adaptation.reason}")
        yield step


def build_diagnoser(machine: Machine, settings: Mapping[str, Any], after: int = 0) -> Diagnoser:
    """The diagnosis from the parameters of the group diagnosis.

    Args:
        machine: as it is known.
        settings: parameters of a run.
        after: experiments after which a verdict takes part; 0 where nothing waits for it.
    """
    from ldt_core.twin.diagnoser import Diagnoser  # few runs need it, and it takes time to load

    return Diagnoser(machine, settings, after=after)


def build_advisor(machine: Machine, settings: Mapping[str, Any]) -> Advisor:
    """The advice to people beside the loop from the parameters of the group advice."""
    from ldt_core.twin.advisor import Advisor  # as above

    return Advisor(machine, settings)


def _is_effect(given: object) -> bool:
    from ldt_core.physics.effect import Effect

    return isinstance(given, Effect)


def build_adaptor(model: Model, settings: Mapping[str, Any]) -> Adaptor:
    """Stage 3 from the parameters of the groups adaptor and diagnosis."""
    memory = Memory(settings["memory_limit"], settings["history"])
    how = {name: settings[name] for name in ("gate", "holdout", "data", "sensor_check")}
    diagnoser = None
    if model.asks_for_diagnosis:
        diagnoser = build_diagnoser(model.machine, settings, settings["diagnosis_after"])
    restore = partial(restore_model, machine=model.machine, settings=settings)
    if settings["model"] == AUTO:
        from ldt_core.twin.contest import ContestAdaptor  # few runs need it, as above

        return ContestAdaptor(model, memory, settings, **how, restore=restore)
    return Adaptor(model, memory, **how, diagnoser=diagnoser, restore=restore)
