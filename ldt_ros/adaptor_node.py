"""Stage 3: `experiment` and `signal` in, `model` and `adaptation` out, `diagnosis` where asked."""

from __future__ import annotations

from typing import Any

from ldt_core.experiment import Experiment, Signal
from ldt_core.models import build_model
from ldt_core.twin import build_adaptor
from ldt_ros.convert import to_message
from ldt_ros.paired_node import PairedNode


class AdaptorNode(PairedNode):
    """Keeps, stores, or learns from each experiment as its signal says.

    A model that learns by what a diagnosis names asks for one first; then this node publishes it,
    and the graph has no diagnoser. It may take 40 s, within which the twin waits unless its
    `adaptation_timeout` is shorter. What the node does with what it receives is said at
    `PairedNode`.
    """

    def __init__(self, **node_arguments: Any) -> None:
        groups = ("machine", "model", "adaptor", "diagnosis")
        super().__init__("adaptor", *groups, **node_arguments)
        model = build_model(self.settings["model"], self.machine, self.settings)
        self.adaptor = build_adaptor(model, self.settings)
        self._model = self.publishes("model")
        self._adaptation = self.publishes("adaptation")
        self._diagnosis = self.publishes("diagnosis") if model.asks_for_diagnosis else None
        self._model.publish(to_message(model.record()))
        self.listen()

    def health(self) -> dict[str, Any]:
        """Model in force, size of S_w, whether it is training."""
        diagnoser = self.adaptor.diagnoser
        trouble = diagnoser.trouble if diagnoser else ""
        values = {
            "model_version": self.adaptor.model.version,
            "warning_set": len(self.adaptor.memory),
            "training": str(self.busy).lower(),
            "unpaired": self.pairs.dropped,
        }
        return {**values, "no diagnosis": trouble} if trouble else values

    def close(self) -> None:
        """Let a training finish, and say what became of it while somebody may listen."""
        if self.adaptor.diagnoser is not None:
            self.adaptor.diagnoser.cancel()  # it may take longer than anybody waits
        self.worker.shutdown(wait=True)

    def step(self, experiment: Experiment, signal: Signal) -> None:
        """Learn, and say what became of it."""
        before = self.adaptor.model.version
        adaptation, model = self.adaptor.step(experiment, signal)
        diagnosis = self.adaptor.diagnosis
        if self._diagnosis is not None and diagnosis is not None:
            self._diagnosis.publish(to_message(diagnosis, experiment.end, self.machine.name))
        if model.version != before:
            self._model.publish(to_message(model.record()))
        self._adaptation.publish(to_message(adaptation, experiment.end, self.machine.name))
