"""Beside the loop: `experiment`, `adaptation`, `model` and `diagnosis` in, `advice` out."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from functools import partial
from typing import Any

from ldt_core.base.experiment import Adaptation, Experiment, ModelRecord
from ldt_core.models import build_model
from ldt_core.twin.loop import build_advisor
from ldt_core.twin.stage import Archive, RecordedStep
from ldt_ros.nodes.interfaces import from_message, to_message
from ldt_ros.nodes.model_versions import ModelVersions
from ldt_ros.nodes.node import LdtNode
from ldt_ros.nodes.pairing import ExperimentPairs
from ldt_ros.nodes.stage_worker import StageWorker


class AdvisorNode(LdtNode):
    """Advises people; no node listens to what it says.

    What it does with `experiment` and `adaptation` is said at `ExperimentPairs`; beside it

    | received | what happens |
    |---|---|
    | `model` | kept until an adaptation names its version; the last twelve |
    | `diagnosis` | counts from then on |
    | more than 100 waiting for a model or an advice | the oldest is left out and counted |

    It is a `Stage` itself: with the advisor, the models go back to where the recording ends.
    """

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("advisor", "machine", "model", "advice", **node_arguments)
        self.advisor = build_advisor(self.machine, self.settings)
        untrained = build_model(self.settings["model"], self.machine, self.settings)
        self._models = ModelVersions(untrained.record())
        self._waiting: deque[tuple[Experiment, Adaptation]] = deque()
        self._made = 0
        self._advice = self.topics.publishes("advice")
        self.topics.listens("model", self._on_model)
        self.topics.listens("diagnosis", self._on_diagnosis)
        self.worker = StageWorker(self, self, "adaptation", awaited=True, answers="advice")
        self.pairs = ExperimentPairs(self, "adaptation", self._pair)
        self.parts = [self.worker, self.pairs]
        self.worker.go_to_the_end(self._met, self._again)
        self.pairs.listen()

    def health(self) -> dict[str, Any]:
        """Last experiment dealt with, whether it is at work, what was lost."""
        values = {
            "experiment": self.worker.finished_with,
            "advices": self._made,
            "advising": self.worker.busy,
            **super().health(),
        }
        trouble = self.advisor.trouble
        return {**values, "no advice": trouble} if trouble else values

    def close(self) -> None:
        """Begin nothing more; what is under way takes a second."""
        self.worker.thread.shutdown(wait=True, cancel_futures=True)

    def recall(self, step: RecordedStep) -> None:
        """Take over what a recorded step says."""
        self.advisor.recall(step)

    def state(self) -> dict[str, Any]:
        """That of the advisor; the models are recorded."""
        return self.advisor.state()

    def return_to(self, state: Mapping[str, Any], archive: Archive) -> None:
        """Take back a state, and the model in force then."""
        present = archive.model(archive.steps[-1].adaptation.model_version).record()
        self.advisor.return_to(state, archive)
        self._models.put(present.version, present)

    def _met(self, step: RecordedStep) -> None:
        self.pairs.met(step)
        if step.model is not None:
            self._models.put(step.model.version, step.model)

    def _again(self, step: RecordedStep) -> None:
        if step.diagnosis is not None:
            self.worker.thread.submit(self.advisor.informed, step.diagnosis)
        self._pair(step.experiment, step.adaptation)

    def _pair(self, experiment: Experiment, beside: Adaptation) -> None:
        """Wait for the model that the adaptation names, and then in turn."""
        self._waiting.append((experiment, beside))
        if len(self._waiting) + self.worker.pending > self.worker.waiting:
            self._waiting.popleft()
            self.worker.left_out += 1
        self._go_on()

    def _on_model(self, message: Any) -> None:
        record = from_message("model", message)
        self._models.put(record.version, record)
        self._go_on()

    def _on_diagnosis(self, message: Any) -> None:
        self.worker.thread.submit(self.advisor.informed, from_message("diagnosis", message))

    def _go_on(self) -> None:
        while self._waiting:
            experiment, adaptation = self._waiting[0]
            model = self._models.get(adaptation.model_version)
            if model is None:
                break
            self._waiting.popleft()
            self.worker.deal(experiment, partial(self._advise, experiment, model), long=True)

    def _advise(self, experiment: Experiment, model: ModelRecord) -> None:
        advice = self.advisor.step(experiment, model)
        if advice is not None:
            self._advice.publish(to_message(advice, experiment.end, self.machine.name))
            self._made += 1
