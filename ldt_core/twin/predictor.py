"""Stage 1 of the loop: the prediction of each experiment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ldt_core.base.errors import (
    FAULTS,
    ExperimentError,
    ModelError,
    UnansweredExperiment,
    reason_of,
)
from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.base.own_process import undivided
from ldt_core.machine.machine_file import Machine
from ldt_core.models.base import Model
from ldt_core.models.physics import PhysicsModel
from ldt_core.twin.numbering import Numbering
from ldt_core.twin.stage import RecordedStep

#: Samples of the idle experiment; compiled code is loaded whatever the length.
WARM_UP_SAMPLES = 3


class Predictor:
    """Stage 1: the present model and the original one predict."""

    def __init__(self, machine: Machine, model: Model) -> None:
        self.machine = machine
        self.model = model
        self.original = PhysicsModel(machine)
        #: Number of the experiment predicted last; None before the first.
        self.last: int | None = None
        self.numbering = Numbering()

    def warm_up(self) -> None:
        """Predict a short experiment that is nobody's, so that the first real one is not late."""
        self.model.predict(self._idle())
        self.original.predict(self._idle())

    def try_out(self, model: Model) -> None:
        """Let a model that somebody sent predict a short experiment that is nobody's.

        In force, one that cannot would leave every experiment without an answer, for good.

        Raises:
            ModelError: it fails.
        """
        try_out(model, self._idle())

    def _idle(self) -> Experiment:
        rest = np.zeros(WARM_UP_SAMPLES)
        return Experiment(1, 0.0, self.machine.sample_period, rest, rest)

    def predict(self, experiment: Experiment) -> Prediction:
        """Free run of the present model.

        Raises:
            ExperimentError: the machine cannot have made this experiment, or its number does not
                follow (`Numbering`; a duplicate would be learned from twice).
            RepeatedExperiment: it is one of the last ones again.
            UnansweredExperiment: the model failed.
        """
        self.admit(experiment)
        return self.answer(experiment)

    def admit(self, experiment: Experiment) -> None:
        """Take an experiment, to answer it later; raises ExperimentError as `predict`."""
        self.machine.check(experiment)
        self.numbering.admit(experiment)

    def answer(self, experiment: Experiment) -> Prediction:
        """Free run of the present model over one that was admitted; raises as `predict`."""
        prediction = _free_run(self.model, experiment)
        self.last = experiment.number
        return prediction

    def predict_original(self, experiment: Experiment) -> Prediction:
        """The same by the model that never learns; raises UnansweredExperiment."""
        return _free_run(self.original, experiment)

    def recall(self, step: RecordedStep) -> None:
        """Take note of the experiment of a recorded step; the model is set by who restores it."""
        self.numbering.recall(step.experiment)
        self.last = step.number

    @property
    def starts(self) -> dict[int, float]:
        """Number and start [s since the epoch] of the last experiments that were taken."""
        return self.numbering.starts


def try_out(model: Model, experiment: Experiment) -> None:
    """Let a model predict an experiment of its machine before it comes into force.

    Raises:
        ModelError: it fails, or predicts what is not finite, or no speed of this machine.
    """
    try:
        with np.errstate(all="ignore"):  # whatever overflows shows in what comes out
            predicted = _judged(model, experiment).speed
        machine = model.machine  # a model of the user's own may have none
        if machine is not None and machine.may_have_made(experiment):
            machine.check(replace(experiment, speed=predicted))
    except FAULTS as error:
        expected = f"one that can predict experiment {experiment.number}"
        raise ModelError(f"model version {model.version}", expected, reason_of(error)) from error


@undivided()
def _free_run(model: Model, experiment: Experiment) -> Prediction:
    try:
        return _judged(model, experiment)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # of a model of the user's own, for one
        raise UnansweredExperiment(experiment.number, reason_of(error)) from error


def _judged(model: Model, experiment: Experiment) -> Prediction:
    """A prediction that can be compared with what was measured; raises where it cannot."""
    prediction = model.predict(experiment)
    gap = prediction.residual(experiment)  # raises where it is not of this experiment
    with np.errstate(over="ignore"):
        if not np.isfinite(gap @ gap):  # nobody could judge it
            where = f"prediction {experiment.number}, speed"
            most = f"{np.abs(prediction.speed).max():g}"
            raise ExperimentError(where, "samples whose squares can be summed", most)
    return prediction
