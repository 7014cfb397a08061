"""Beside the loop: `experiment` and `signal` in, `diagnosis` out."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

from ldt_core.experiment import Experiment, Level, Signal
from ldt_core.twin import build_diagnoser
from ldt_ros.convert import from_message, to_message
from ldt_ros.node import TwinNode
from ldt_ros.pairing import Pairing

WAITING = (
    1000  # experiments that may wait for a diagnosis under way; beyond, the newest is left out
)
NEWS = 0.2  # s, how soon the end of a run learns that nothing waits any more


class DiagnoserNode(TwinNode):
    """Says at positives what has happened to the machine.

    The diagnosis runs on a thread of its own, so that health is told meanwhile; experiments that
    come then wait for it in order. Told to stop, it is broken off, and nobody waits for it.

    | received | what happens |
    |---|---|
    | `experiment`, `signal` | the two of one number go through the diagnoser |
    | more than 1000 while a diagnosis runs | the newest is left out and counted |
    | one without the other | dropped when 100 newer ones have come, and counted |
    | a number that waits already | dropped and counted: the first one counts |
    | anything malformed | counted, logged once per kind |
    """

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("diagnoser", "machine", "diagnosis", **node_arguments)
        self.diagnoser = build_diagnoser(self.machine, self.settings)
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="diagnoser")
        # One thread writes each, so that neither needs a lock.
        self._begun = 0
        self._ended = 0
        self._last = 0
        self._told_last = 0
        self._made = 0
        self._left_out = 0
        self._pairs: Pairing[Experiment, Signal] = Pairing(self._on_pair)
        self._diagnosis = self.publishes("diagnosis")
        self.listens("experiment", self._on_experiment)
        self.listens("signal", self._on_signal)
        self.create_timer(NEWS, self._tell_progress, clock=self.steady)

    def health(self) -> dict[str, Any]:
        """Last experiment dealt with, whether it is diagnosing, what came to nothing."""
        values = {
            "experiment": self._last,
            "diagnoses": self._made,
            "diagnosing": str(self._begun > self._ended).lower(),
            "dropped": self._left_out,
            "unpaired": self._pairs.dropped,
        }
        trouble = self.diagnoser.trouble
        return {**values, "no diagnosis": trouble} if trouble else values

    def halt(self) -> None:
        """Break off the diagnosis under way."""
        self.diagnoser.cancel()

    def close(self) -> None:
        """Begin nothing more."""
        self.diagnoser.cancel()
        self._worker.shutdown(wait=False, cancel_futures=True)

    def _on_experiment(self, message: Any) -> None:
        experiment = from_message("experiment", message)
        # What the twin refuses and tells of must not wait here for its corrected successor.
        if self.machine.may_have_made(experiment):
            self._pairs.left(experiment.number, experiment)

    def _on_signal(self, message: Any) -> None:
        signal = from_message("signal", message)
        self._pairs.right(signal.experiment, signal)

    def _on_pair(self, experiment: Experiment, signal: Signal) -> None:
        if self._begun - self._ended > WAITING:
            self._left_out += 1
        elif signal.level is Level.POSITIVE or self._begun > self._ended:
            self._begun += 1
            self._worker.submit(self._step_on_thread, experiment, signal)
        else:
            self._step(experiment, signal)

    def _step_on_thread(self, experiment: Experiment, signal: Signal) -> None:
        try:
            self._step(experiment, signal)
        except Exception as error:  # would be lost in the thread's future
            self.failure = error
        finally:
            self._ended += 1

    def _step(self, experiment: Experiment, signal: Signal) -> None:
        found = self.diagnoser.step(experiment, signal)
        if found is not None and not self.diagnoser.cancelled:
            self._diagnosis.publish(to_message(found, experiment.end, self.machine.name))
            self._made += 1
        self._last = experiment.number

    def _tell_progress(self) -> None:
        """The end of a run waits for the last experiment to be dealt with."""
        if self._last != self._told_last and self._begun == self._ended:
            self._told_last = self._last
            self.tell()
