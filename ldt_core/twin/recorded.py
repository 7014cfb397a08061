"""What a stage of the loop is told of the run that it goes on with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from ldt_core.base.experiment import (
    Adaptation,
    AdviceRecord,
    DiagnosisRecord,
    Experiment,
    ModelRecord,
    Prediction,
    Signal,
)
from ldt_core.machine.machine_file import Machine
from ldt_core.models import restore_model
from ldt_core.models.base import Model

WINDOW = 100  # experiments that may come again, as many as a topic's queue holds


@dataclass(frozen=True)
class RecordedStep:
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


class Archive(Protocol):
    """Finds what was recorded in a run, by its number."""

    steps: list[RecordedStep]

    def experiment(self, number: Any, start: Any) -> Experiment:
        """The experiment with this number and start [s]; RecordingError where there is none."""

    def model(self, version: Any) -> Model:
        """The model of a version; RecordingError where there is none."""

    def diagnosis(self, number: Any) -> DiagnosisRecord:
        """The diagnosis made at an experiment; RecordingError where there is none."""
