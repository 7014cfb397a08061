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
from ldt_ros.nodes.convert import from_message, to_message
from ldt_ros.nodes.versions import Versions
from ldt_ros.nodes.worker_node import WorkerNode


class AdvisorNode(WorkerNode):
    """Advises people; no node listens to what it says.

    What it does with `experiment` and `adaptation` is said at `PairedNode`; beside it

    | received | what happens |
    |---|---|
    | `model` | kept until an adaptation names its version; the last twelve |
    | `diagnosis` | counts from then on |
    | more than 100 waiting for a model or an advice | the oldest is left out and counted |
    """

    beside = "adaptation"
    answers = "advice"
    awaited = True

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("advisor", "machine", "model", "advice", **node_arguments)
        self.advisor = build_advisor(self.machine, self.settings)
        untrained = build_model(self.settings["model"], self.machine, self.settings)
        self._models: Versions[ModelRecord] = Versions(untrained.record())
        self._waiting: deque[tuple[Experiment, Adaptation]] = deque()
        self._made = 0
        self._advice = self.publishes("advice")
        self.listens("model", self._on_model)
        self.listens("diagnosis", self._on_diagnosis)
        self.listen(self.advisor)

    def health(self) -> dict[str, Any]:
        """Last experiment dealt with, whether it is at work, what was lost."""
        values = {
            "experiment": self.finished_with,
            "advices": self._made,
            "advising": str(self.busy).lower(),
            **super().health(),
        }
        trouble = self.advisor.trouble
        return {**values, "no advice": trouble} if trouble else values

    def close(self) -> None:
        """Begin nothing more; what is under way takes a second."""
        self.worker.shutdown(wait=True, cancel_futures=True)

    def pair(self, experiment: Experiment, beside: Adaptation) -> None:
        """Wait for the model that the adaptation names, and then in turn."""
        self._waiting.append((experiment, beside))
        if len(self._waiting) + self._begun - self._ended > self.waiting:
            self._waiting.popleft()
            self.left_out += 1
        self._go_on()

    def take_up(self, step: RecordedStep) -> None:
        """Be as after a recorded step, unless its advice may have been under way."""
        if step.model is not None:
            self._models.put(step.model.version, step.model)
        if step.experiment.number <= self.answered:
            super().take_up(step)
        else:
            if step.diagnosis is not None:
                self.worker.submit(self.advisor.informed, step.diagnosis)
            self.pair(step.experiment, step.adaptation)

    def make_up(self, step: RecordedStep) -> None:
        """Be as after a step that was missed: advice on it is out of date."""
        super().take_up(step)

    def return_to(self, state: Mapping[str, Any], archive: Archive) -> None:
        """Take back a state."""
        present = archive.model(archive.steps[-1].adaptation.model_version).record()
        super().return_to(state, archive)
        self._models.put(present.version, present)

    def _on_model(self, message: Any) -> None:
        record = from_message("model", message)
        self._models.put(record.version, record)
        self._go_on()

    def _on_diagnosis(self, message: Any) -> None:
        self.worker.submit(self.advisor.informed, from_message("diagnosis", message))

    def _go_on(self) -> None:
        while self._waiting:
            experiment, adaptation = self._waiting[0]
            model = self._models.get(adaptation.model_version)
            if model is None:
                break
            self._waiting.popleft()
            self.deal(experiment.number, partial(self._advise, experiment, model), True)

    def _advise(self, experiment: Experiment, model: ModelRecord) -> None:
        advice = self.advisor.step(experiment, model)
        if advice is not None:
            self._advice.publish(to_message(advice, experiment.end, self.machine.name))
            self._made += 1
        self.passed(experiment)
