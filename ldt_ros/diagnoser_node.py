"""Beside the loop: `experiment` and `signal` in, `diagnosis` out."""

from __future__ import annotations

import functools
from typing import Any

from ldt_core.experiment import Experiment, Signal
from ldt_core.lookup import Lookup
from ldt_core.past import Past
from ldt_core.twin import build_diagnoser
from ldt_ros.convert import to_message
from ldt_ros.worker_node import WorkerNode


class DiagnoserNode(WorkerNode):
    """Says at positives what has happened to the machine.

    Told to stop, it breaks off the diagnosis, and nobody waits for it. What it does with what it
    receives is said at `WorkerNode` and `PairedNode`; a thousand experiments may wait.
    """

    beside = "signal"
    waiting = 1000
    awaited = True

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("diagnoser", "machine", "diagnosis", **node_arguments)
        self.diagnoser = build_diagnoser(self.machine, self.settings)
        self._made = 0
        self._diagnosis = self.publishes("diagnosis")
        self.listen()

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

    @functools.cached_property
    def _answered(self) -> int:
        """The last experiment of which the diagnosis, if any, is recorded."""
        return max(self.known, self.last_recorded("diagnosis", self.known))

    def take_up(self, step: Past) -> None:
        """Be as after a recorded step, unless its diagnosis may have been under way."""
        if step.experiment.number <= self._answered:
            super().take_up(step)
        else:
            self.pair(step.experiment, step.signal)

    def make_up(self, step: Past) -> None:
        """Be as after a step that was missed, its diagnosis included."""
        if step.experiment.number <= self._answered:
            super().take_up(step)
        else:
            self.step(step.experiment, step.signal)

    def mark(self) -> dict[str, Any] | None:
        """What it has come to know."""
        return self.diagnoser.mark()

    def return_to(self, mark: dict[str, Any], recorded: Lookup) -> None:
        """Be as when the mark was made."""
        self.diagnoser.return_to(mark, recorded)
        super().return_to(mark, recorded)

    def recall(self, step: Past) -> None:
        """Take over what a recorded step says."""
        self.diagnoser.recall(step)

    def step(self, experiment: Experiment, beside: Signal) -> None:
        """Diagnose at a positive."""
        found = self.diagnoser.step(experiment, beside)
        if found is not None and not self.diagnoser.cancelled:
            self._diagnosis.publish(to_message(found, experiment.end, self.machine.name))
            self._made += 1
