"""Beside the loop: `experiment` and `signal` in, `diagnosis` out."""

from __future__ import annotations

from functools import partial
from typing import Any

from ldt_core.base.experiment import Experiment, Level, Signal
from ldt_core.twin.loop import build_diagnoser
from ldt_ros.nodes.interfaces import to_message
from ldt_ros.nodes.node import LdtNode
from ldt_ros.nodes.pairing import ExperimentPairs
from ldt_ros.nodes.stage_worker import StageWorker

#: Experiments that may wait for a diagnosis.
WAITING = 1000


class DiagnoserNode(LdtNode):
    """Says at positives what has happened to the machine.

    Told to stop, it breaks off the diagnosis, and nobody waits for it. What it does with what it
    receives is said at `ExperimentPairs` and `StageWorker`.
    """

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("diagnoser", "machine", "diagnosis", **node_arguments)
        self.diagnoser = build_diagnoser(self.machine, self.settings)
        self._made = 0
        self._diagnosis = self.topics.publishes("diagnosis")
        self.worker = StageWorker(
            self, self.diagnoser, "signal", waiting=WAITING, awaited=True, answers="diagnosis"
        )
        self.pairs = ExperimentPairs(self, "signal", self._pair)
        self.parts = [self.worker, self.pairs]
        self.worker.go_to_the_end(
            self.pairs.met,
            again=lambda step: self._pair(step.experiment, step.signal),
            make_up=lambda step: self._diagnose(step.experiment, step.signal),
        )
        self.pairs.listen()

    def health(self) -> dict[str, Any]:
        """Last experiment dealt with, whether it is diagnosing, what came to nothing."""
        values = {
            "experiment": self.worker.finished_with,
            "diagnoses": self._made,
            "diagnosing": self.worker.busy,
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
        self.worker.thread.shutdown(wait=False, cancel_futures=True)

    def _pair(self, experiment: Experiment, beside: Signal) -> None:
        work = partial(self._diagnose, experiment, beside)
        self.worker.deal(experiment, work, beside.level is Level.POSITIVE)

    def _diagnose(self, experiment: Experiment, signal: Signal) -> None:
        found = self.diagnoser.step(experiment, signal)
        if found is not None and not self.diagnoser.cancelled:
            self._diagnosis.publish(to_message(found, experiment.end, self.machine.name))
            self._made += 1
