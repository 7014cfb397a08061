"""Stage 1 of the loop: the prediction of each experiment."""

from __future__ import annotations

import numpy as np

from ldt_core.base.bounded import forget_oldest
from ldt_core.base.errors import (
    ExperimentError,
    RepeatedExperiment,
    UnansweredExperiment,
    reason_of,
)
from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.machine.machine_file import Machine
from ldt_core.models.base import Model
from ldt_core.models.physics import PhysicsModel
from ldt_core.twin.stage import WINDOW, RecordedStep

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
            UnansweredExperiment: the model failed.
        """
        self.machine.check(experiment)
        if self.last is not None and experiment.number <= self.last:
            known = self._starts.get(experiment.number) == experiment.start
            raise out_of_order(experiment, self.last, known)
        prediction = self._free_run(self.model, experiment)
        self._took(experiment)
        return prediction

    def predict_original(self, experiment: Experiment) -> Prediction:
        """The same by the model that never learns; raises UnansweredExperiment."""
        return self._free_run(self.original, experiment)

    def _free_run(self, model: Model, experiment: Experiment) -> Prediction:
        try:
            return model.predict(experiment)
        except Exception as error:  # of a model of the user's own, for one
            raise UnansweredExperiment(experiment.number, reason_of(error)) from error

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


def out_of_order(experiment: Experiment, last: int, known: bool) -> ExperimentError:
    """Why an experiment is not taken whose number is not above the last one's.

    Args:
        last: number of the last one taken.
        known: whether it has been taken itself.
    """
    kind = RepeatedExperiment if known else ExperimentError
    return kind(f"experiment {experiment.number}", f"a number above {last}", experiment.number)
