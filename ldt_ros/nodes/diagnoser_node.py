"""Beside the loop: `experiment` and `signal` in, `diagnosis` out."""

from __future__ import annotations

from typing import Any

from ldt_core.base.experiment import Experiment, Signal
from ldt_core.twin.loop import build_diagnoser
from ldt_core.twin.stage import RecordedStep
from ldt_ros.nodes.convert import to_message
from ldt_ros.nodes.worker_node import WorkerNode


class DiagnoserNode(WorkerNode):
    """Says at positives what has happened to the machine.

    Told to stop, it breaks off the diagnosis, and nobody waits for it. What it does with what it
    receives is said at `WorkerNode` and `PairedNode`; a thousand experiments may wait.
    """

    beside = "signal"
    answers = "diagnosis"
    waiting = 1000
    awaited = True

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("diagnoser", "machine", "diagnosis", **node_arguments)
        self.diagnoser = build_diagnoser(self.machine, self.settings)
        self._made = 0
        self._diagnosis = self.publishes("diagnosis")
        self.listen(self.diagnoser)

    def health(self) -> dict[str, Any]:
        """Last experiment dealt with, whether it is diagnosing, what came to nothing."""
        values = {
            "experiment": self.finished_with,
            "diagnoses": self._made,
            "diagnosing": str(self.busy).lower(),
            **super().health(),
        }
        trouble = self.diagnoser.trouble
        return {**values, "no diagnosis": trouble} if trouble else values

    def halt(self) -> None:
        """Break off the diagnosis under way."""
        self.diagnoser.cancel()

    def close(self) -> None:
        """Begin nothing more."""
        self.diagnoser.cancel()
        self.worker.shutdown(wait=False, cancel_futures=True)

    def take_up(self, step: RecordedStep) -> None:
        """Be as after a recorded step, unless its diagnosis may have been under way."""
        if step.experiment.number <= self.answered:
            super().take_up(step)
        else:
            self.pair(step.experiment, step.signal)

    def make_up(self, step: RecordedStep) -> None:
        """Be as after a step that was missed, its diagnosis included."""
        if step.experiment.number <= self.answered:
            super().take_up(step)
        else:
            self.step(step.experiment, step.signal)

    def step(self, experiment: Experiment, beside: Signal) -> None:
        """Diagnose at a positive."""
        found = self.diagnoser.step(experiment, beside)
        if found is not None and not self.diagnoser.cancelled:
            self._diagnosis.publish(to_message(found, experiment.end, self.machine.name))
            self._made += 1
