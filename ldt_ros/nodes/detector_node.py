"""Stage 2: `experiment` and `prediction` in, `signal` out."""

from __future__ import annotations

from typing import Any

from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.twin.loop import build_detector_stage
from ldt_ros.nodes.convert import to_message
from ldt_ros.nodes.paired_node import PairedNode


class DetectorNode(PairedNode):
    """Judges each prediction once the experiment of the same number is there.

    A pair of different lengths is rejected; what else it does with what it receives is said at
    `PairedNode`.
    """

    beside = "prediction"

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("detector", "machine", "detector", **node_arguments)
        self.detector = build_detector_stage(self.settings)
        self._signal = self.publishes("signal")
        self._last = ""
        self.listen(self.detector)

    def health(self) -> dict[str, Any]:
        """Last signal."""
        return {"signal": self._last, **super().health()}

    def pair(self, experiment: Experiment, beside: Prediction) -> None:
        """Judge, and say so."""
        self.in_turn(experiment.number)
        signal = self.detector.step(experiment, beside)
        self._last = signal.level.word
        self._signal.publish(to_message(signal, experiment.end, self.machine.name))
        self.passed(experiment)
