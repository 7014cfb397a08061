"""The experiments of a recording with what was predicted of each, one at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.recording.bag import Bag
from ldt_core.recording.held_samples import HeldSamples
from ldt_core.views.step_view import belongs


@dataclass(frozen=True)
class PredictedRun:
    """An experiment, and its predictions where the recording has them."""

    experiment: Experiment
    prediction: Prediction | None = None
    original: Prediction | None = None

    @property
    def predicted(self) -> bool:
        """Whether both predictions are there."""
        return self.prediction is not None and self.original is not None

    def fits(self, prediction: Prediction) -> bool:
        """Whether a prediction is of this experiment."""
        return belongs(prediction, self.experiment)

    def beside(self, topic: str, prediction: Prediction) -> PredictedRun:
        """The same with a prediction of a topic, `prediction` or `original_prediction`."""
        if topic == "prediction":
            return replace(self, prediction=prediction)
        return replace(self, original=prediction)

    def curves(self) -> dict[str, Array]:
        """Name → (L,) samples of all that was measured or predicted, in SI units."""
        e, p, o = self.experiment, self.prediction, self.original
        found = {"voltage": e.voltage, "speed": e.speed}
        if e.current is not None:
            found["current"] = e.current
        if p is not None:
            found["predicted_speed"] = p.speed
            if p.speed_std is not None:
                found["predicted_speed_std"] = p.speed_std
        if o is not None:
            found["original_speed"] = o.speed
        return found


class Predictions:
    """Those of a recording, to be put beside its experiments."""

    def __init__(self, bag: Bag) -> None:
        held = HeldSamples()
        self._twin = {p.number: p for p in held.predictions(bag, "prediction")}
        self._original = {p.number: p for p in held.predictions(bag, "original_prediction")}

    def beside(self, experiment: Experiment) -> PredictedRun:
        """The experiment with its own."""
        of = (p.get(experiment.number) for p in (self._twin, self._original))
        fitting = (p if p is not None and belongs(p, experiment) else None for p in of)
        return PredictedRun(experiment, *fitting)


def predicted_runs(bag: Bag) -> Iterator[PredictedRun]:
    """All experiments in recorded order.

    Raises:
        RecordingError, ExperimentError: as `Bag.experiments`.
    """
    predictions = Predictions(bag)
    return map(predictions.beside, bag.experiments())
