"""Beside the loop: `experiment` and `signal` in, `diagnosis` out."""

from __future__ import annotations

from typing import Any

from ldt_core.experiment import Experiment, Signal
from ldt_core.twin import build_diagnoser
from ldt_ros.convert import to_message
from ldt_ros.paired_node import PairedNode

NEWS = 0.2  # s, how soon the end of a run learns that nothing waits any more


class DiagnoserNode(PairedNode):
    """Says at positives what has happened to the machine.

    Told to stop, it breaks off the diagnosis, and nobody waits for it. What it does with what it
    receives is said at `PairedNode`; a thousand experiments may wait.
    """

    waiting = 1000

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("diagnoser", "machine", "diagnosis", **node_arguments)
        self.diagnoser = build_diagnoser(self.machine, self.settings)
        self._last = 0
        self._told_last = 0
        self._made = 0
        self._diagnosis = self.publishes("diagnosis")
        self.listen()
        self.create_timer(NEWS, self._tell_progress, clock=self.steady)

    def health(self) -> dict[str, Any]:
        """Last experiment dealt with, whether it is diagnosing, what came to nothing."""
        values = {
            "experiment": self._last,
            "diagnoses": self._made,
            "diagnosing": str(self.busy).lower(),
            "dropped": self.left_out,
            "unpaired": self.pairs.dropped,
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

    def step(self, experiment: Experiment, signal: Signal) -> None:
        """Diagnose where it is positive."""
        found = self.diagnoser.step(experiment, signal)
        if found is not None and not self.diagnoser.cancelled:
            self._diagnosis.publish(to_message(found, experiment.end, self.machine.name))
            self._made += 1
        self._last = experiment.number

    def _tell_progress(self) -> None:
        """The end of a run waits for the last experiment to be dealt with."""
        if self._last != self._told_last and not self.busy:
            self._told_last = self._last
            self.tell()
