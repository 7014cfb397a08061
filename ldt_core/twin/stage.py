"""What every stage of the loop offers, so that a run can go on from its recording."""

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
from ldt_core.models.base import Model

#: Experiments that may come again: as many as a topic's queue holds.
WINDOW = 100


@dataclass(frozen=True)
class RecordedStep:
    """A complete step, as it was recorded.

    Args:
        adaptation: what was done; after a rollback, that.
        model: adopted in this step, or by a rollback; None where the model stayed.
        original: by the model that never learns, or None where it was not read.
        behind_gap: whether the twin made steps right before it that are not recorded whole.
    """

    experiment: Experiment
    prediction: Prediction
    signal: Signal
    adaptation: Adaptation
    model: ModelRecord | None = None
    diagnosis: DiagnosisRecord | None = None
    advice: AdviceRecord | None = None
    original: Prediction | None = None
    behind_gap: bool = False

    def __repr__(self) -> str:
        return f"RecordedStep({self.number}, {self.signal.level.word}, {self.adaptation.action})"

    @property
    def number(self) -> int:
        """Of its experiment."""
        return self.experiment.number


class Archive(Protocol):
    """Finds what was recorded in a run, by its number."""

    #: The last steps up to that of the checkpoint, that one last.
    steps: list[RecordedStep]

    def experiment(self, number: Any, start: Any) -> Experiment:
        """The experiment with this number and start [s]; RecordingError where there is none."""

    def model(self, version: Any) -> Model:
        """The model of a version; RecordingError where there is none."""

    def diagnosis(self, number: Any) -> DiagnosisRecord:
        """The diagnosis made at an experiment; RecordingError where there is none."""


class Stage(Protocol):
    """A part of the twin that comes to know something: detector, adaptor, diagnoser, advisor."""

    def recall(self, step: RecordedStep) -> None:
        """Take over what a recorded step says, without doing its work again.

        Raises:
            RecordingError: a step that this stage cannot have taken part in.
            ModelError: a recorded model that cannot be this machine's.
        """

    def state(self) -> dict[str, Any] | None:
        """What it knows, in JSON types; None where it cannot tell all of it.

        Numbers stand for the experiments, models and diagnoses that are recorded.
        """

    def return_to(self, state: Mapping[str, Any], archive: Archive) -> None:
        """Take back a state, before any step here.

        Raises:
            RecordingError: something that is not recorded; the stage is then as it was.
            LdtError, ValueError, TypeError, KeyError, AttributeError: no such state; the same.
        """
