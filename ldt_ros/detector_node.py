"""Stage 2: `experiment` and `prediction` in, `signal` out."""

from __future__ import annotations

from typing import Any

from ldt_core.experiment import Experiment, Prediction
from ldt_core.twin import build_judge
from ldt_ros.convert import from_message, to_message
from ldt_ros.node import TwinNode
from ldt_ros.pairing import Pairing


class DetectorNode(TwinNode):
    """Judges each prediction once the experiment of the same number is there.

    | received | what happens |
    |---|---|
    | `experiment`, `prediction` | the two of one number are judged |
    | one without the other | dropped when 100 newer ones have come, and counted |
    | a number that waits already | dropped and counted: the first one counts |
    | a pair of different lengths | rejected |
    | anything malformed | counted, logged once per kind |
    """

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("detector", "machine", "detector", **node_arguments)
        self.judge = build_judge(self.settings)
        self._pairs: Pairing[Experiment, Prediction] = Pairing(self._on_pair)
        self._signal = self.publishes("signal")
        self._last = ""
        self.listens("experiment", self._on_experiment)
        self.listens("prediction", self._on_prediction)

    def health(self) -> dict[str, Any]:
        """Last signal, and what never found its other half."""
        return {"signal": self._last, "unpaired": self._pairs.dropped}

    def _on_experiment(self, message: Any) -> None:
        experiment = from_message("experiment", message)
        # What the twin refuses and tells of must not wait here for its corrected successor.
        if self.machine.may_have_made(experiment):
            self._pairs.left(experiment.number, experiment)

    def _on_prediction(self, message: Any) -> None:
        prediction = from_message("prediction", message)
        self._pairs.right(prediction.number, prediction)

    def _on_pair(self, experiment: Experiment, prediction: Prediction) -> None:
        signal = self.judge.judge(experiment, prediction)
        self._last = signal.level.word
        self._signal.publish(to_message(signal, experiment.end, self.machine.name))
