"""Stage 3: `experiment` and `signal` in, `model` and `adaptation` out, `diagnosis` where asked."""

from __future__ import annotations

from typing import Any

from ldt_core.experiment import Experiment, Signal
from ldt_core.models import build_model
from ldt_core.past import Past
from ldt_core.twin import build_adaptor
from ldt_ros.convert import to_message
from ldt_ros.worker_node import WorkerNode


class AdaptorNode(WorkerNode):
    """Keeps, stores, or learns from each experiment as its signal says.

    A model that learns by what a diagnosis names asks for one first; then this node publishes it,
    and the graph has no diagnoser. It may take 40 s, within which the twin waits unless its
    `adaptation_timeout` is shorter. What the node does with what it receives is said at
    `WorkerNode` and `PairedNode`.
    """

    beside = "signal"

    def __init__(self, **node_arguments: Any) -> None:
        groups = ("machine", "model", "adaptor", "diagnosis")
        super().__init__("adaptor", *groups, **node_arguments)
        model = build_model(self.settings["model"], self.machine, self.settings)
        self.adaptor = build_adaptor(model, self.settings)
        self._model = self.publishes("model")
        self._adaptation = self.publishes("adaptation")
        self._diagnosis = self.publishes("diagnosis") if model.asks_for_diagnosis else None
        self.listen(self.adaptor)
        self._model.publish(to_message(self.adaptor.model.record()))

    def health(self) -> dict[str, Any]:
        """Model in force, size of S_w, whether it is training."""
        diagnoser = self.adaptor.diagnoser
        trouble = diagnoser.trouble if diagnoser else ""
        values = {
            "model_version": self.adaptor.model.version,
            "warning_set": len(self.adaptor.memory),
            "training": str(self.busy).lower(),
            **super().health(),
        }
        return {**values, "no diagnosis": trouble} if trouble else values

    def close(self) -> None:
        """Let a training finish, and say what became of it while somebody may listen."""
        if self.adaptor.diagnoser is not None:
            self.adaptor.diagnoser.cancel()  # it may take longer than anybody waits
        self.worker.shutdown(wait=True)

    def recall(self, step: Past) -> None:
        """Take over what a recorded step says."""
        self.adaptor.recall(step, step.restored(self.machine, self.settings))

    def step(self, experiment: Experiment, beside: Signal) -> None:
        """Keep, store or learn, and say so."""
        before = self.adaptor.model.version
        adaptation, model = self.adaptor.step(experiment, beside)
        diagnosis = self.adaptor.diagnosis
        if self._diagnosis is not None and diagnosis is not None:
            self._diagnosis.publish(to_message(diagnosis, experiment.end, self.machine.name))
        if model.version != before:
            self._model.publish(to_message(model.record()))
        self._adaptation.publish(to_message(adaptation, experiment.end, self.machine.name))
