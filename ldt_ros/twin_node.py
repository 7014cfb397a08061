"""Stage 1: `experiment` and `model` in, `prediction` and `original_prediction` out."""

from __future__ import annotations

import time
from collections import deque
from typing import Any

from ldt_core.errors import ExperimentError, LdtError
from ldt_core.experiment import Adaptation, Experiment
from ldt_core.models import build_model, restore_model
from ldt_core.models.base import Model
from ldt_core.twin import Predictor
from ldt_ros.convert import from_message, to_message
from ldt_ros.node import REFUSED, TwinNode

TICK = 0.05  # s, how often a time-out is looked for
KEPT_MODELS = 3  # a model may arrive before the adaptation that names it; older ones are not needed
QUEUE = 100  # experiments that may wait for an adaptation; beyond, the oldest are dropped


class PredictorNode(TwinNode):
    """Predicts each experiment after the adaptation of the one before.

    | received | what happens |
    |---|---|
    | `experiment` | predicted, once the adaptation of the last one and its model are there |
    | no such adaptation within `adaptation_timeout` | predicted all the same; logged, counted |
    | `experiment`, number not above the last | rejected, `refused experiment` told at once |
    | `experiment`, impossible for the machine | rejected, `refused experiment` told at once |
    | more than 100 experiments waiting | the oldest is dropped and counted |
    | `model` | kept until an adaptation names its version; the last three |
    | `adaptation` of an earlier one | its model is taken when the time is out |
    | `adaptation` of one not predicted | ignored |
    | anything malformed | counted, logged once per kind |

    `refused experiment` is in `/diagnostics`: no adaptation of that number will come, which those
    who wait for it need to know.
    """

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("twin", "machine", "model", "twin", **node_arguments)
        model = build_model(self.settings["model"], self.machine, self.settings)
        self.predictor = Predictor(self.machine, model)
        self.predictor.warm_up()
        self._models: dict[int, Model] = {model.version: model}
        self._waiting: deque[tuple[Experiment, float]] = deque()
        self._adapted: Adaptation | None = None
        self._predicted_at = 0.0
        self._refused = 0
        self._timeouts = 0
        self._dropped = 0
        self._prediction = self.publishes("prediction")
        self._original = self.publishes("original_prediction")
        self.listens("model", self._on_model)
        self.listens("adaptation", self._on_adaptation)
        self.listens("experiment", self._on_experiment)
        self.create_timer(TICK, self._go_on, clock=self.steady)

    def health(self) -> dict[str, Any]:
        """Model in force, queue, time-outs."""
        return {
            "model_version": self.predictor.model.version,
            "experiment": self.predictor.last,
            "waiting": len(self._waiting),
            "dropped": self._dropped,
            REFUSED: self._refused,
            "adaptation time-outs": self._timeouts,
        }

    def _on_model(self, message: Any) -> None:
        record = from_message("model", message)
        known = self._models.get(record.version)
        # An adaptor that was started again counts its versions from the beginning.
        same = known is not None and known.record() == record
        model = known if same else restore_model(record, self.machine, self.settings)
        self._models.pop(record.version, None)
        self._models[record.version] = model  # at the end: the last that came
        while len(self._models) > KEPT_MODELS:
            del self._models[next(iter(self._models))]
        self._go_on()

    def _on_adaptation(self, message: Any) -> None:
        adaptation = from_message("adaptation", message)
        last, newest = self.predictor.last, self._adapted
        if last is None or adaptation.experiment > last:
            return
        if newest is None or adaptation.experiment > newest.experiment:
            self._adapted = adaptation
            self._go_on()

    def _refuse(self, experiment: Experiment, error: LdtError) -> None:
        self.reject("experiment", error)
        self._refused = experiment.number
        self.tell()

    def _on_experiment(self, message: Any) -> None:
        experiment = from_message("experiment", message)
        last = self._waiting[-1][0].number if self._waiting else self.predictor.last
        if last is not None and experiment.number <= last:
            where = f"experiment {experiment.number}"
            error = ExperimentError(where, f"a number above {last}", experiment.number)
            self._refuse(experiment, error)
            return
        self._waiting.append((experiment, time.monotonic()))
        if len(self._waiting) > QUEUE:
            self._waiting.popleft()
            self._dropped += 1
        self._go_on()

    def _go_on(self) -> None:
        while self._waiting and self._may_predict(*self._waiting[0]):
            experiment, _ = self._waiting.popleft()
            try:
                prediction = self.predictor.predict(experiment)
            except LdtError as error:
                self._refuse(experiment, error)
                continue
            self._prediction.publish(to_message(prediction))
            self._predicted_at = time.monotonic()
            try:
                # Nobody waits for the yardstick, so it is made while the detector works.
                self._original.publish(to_message(self.predictor.original.predict(experiment)))
            except LdtError as error:
                self.reject("experiment", error)

    def _may_predict(self, experiment: Experiment, since: float) -> bool:
        last, adapted = self.predictor.last, self._adapted
        if last is None:
            # The first that this node sees: nothing can have been learned from it before.
            self.predictor.model = next(reversed(self._models.values()))
            return True
        if adapted is not None and adapted.experiment == last:
            model = self._models.get(adapted.model_version)
            if model is not None:
                self.predictor.model = model
                return True
        # A backlog is no reason to hurry: the time runs from when this one's turn came.
        turn = max(since, self._predicted_at)
        if time.monotonic() - turn < self.settings["adaptation_timeout"]:
            return False
        if adapted is not None and adapted.model_version in self._models:
            self.predictor.model = self._models[adapted.model_version]
        self._timeouts += 1
        self.get_logger().warning(
            f"no adaptation of experiment {last} within {self.settings['adaptation_timeout']:g} s: "
            f"experiment {experiment.number} is predicted by model {self.predictor.model.version}"
        )
        return True
