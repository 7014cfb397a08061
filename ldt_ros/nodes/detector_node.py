"""Stage 2: `experiment` and `prediction` in, `signal` out."""

from __future__ import annotations

from functools import partial
from typing import Any

from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.twin.detector_stage import build_detector_stage
from ldt_ros.nodes.interfaces import to_message
from ldt_ros.nodes.node import LdtNode
from ldt_ros.nodes.pairing import ExperimentPairs
from ldt_ros.nodes.stage_worker import StageWorker


class DetectorNode(LdtNode):
    """Compares each prediction with the experiment of the same number once both are there.

    A pair of different lengths is rejected; what else it does with what it receives is said at
    `ExperimentPairs`.
    """

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("detector", "machine", "detector", **node_arguments)
        self.detector = build_detector_stage(self.settings)
        self._signal = self.topics.publishes("signal")
        self._last = {"signal": "", "state": ""}
        self.worker = StageWorker(self, self.detector, "prediction")
        self.pairs = ExperimentPairs(self, "prediction", self._pair)
        self.parts = [self.pairs]  # nothing takes long, so that the worker has nothing to tell
        self.worker.go_to_the_end(self.pairs.met)
        self.pairs.listen()

    def health(self) -> dict[str, Any]:
        """Last signal, and the state of machine and model beside it."""
        values = {**self._last, **super().health()}
        return {**values, "no signal": trouble} if (trouble := self.detector.trouble) else values

    def _pair(self, experiment: Experiment, beside: Prediction) -> None:
        self.worker.deal(experiment, partial(self._detect, experiment, beside), long=False)

    def _detect(self, experiment: Experiment, prediction: Prediction) -> None:
        signal = self.detector.step(experiment, prediction)
        self._last = {"signal": signal.level.word, "state": signal.state}
        self._signal.publish(to_message(signal, experiment.end, self.machine.name))
