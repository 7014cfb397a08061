"""A node that deals with each experiment together with its signal, at positives at length."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

from ldt_core.errors import LdtError
from ldt_core.experiment import Experiment, Level, Signal
from ldt_ros.convert import from_message
from ldt_ros.node import TwinNode
from ldt_ros.pairing import Pairing


class PairedNode(TwinNode):
    """Calls `step` with the experiment and the signal of one number, in order.

    What a positive asks for takes long: it runs on a thread of its own, so that health is told
    meanwhile, and experiments that come then wait for it there.

    | received | what happens |
    |---|---|
    | `experiment`, `signal` | the two of one number go to `step` |
    | more than `waiting` while one takes long | the newest is left out and counted |
    | one without the other | dropped when 100 newer ones have come, and counted |
    | a number that waits already | dropped and counted: the first one counts |
    | anything malformed, or that `step` refuses | counted, logged once per kind |
    """

    #: Experiments that may wait for one that takes long.
    waiting = float("inf")

    def __init__(self, name: str, *groups: str, **node_arguments: Any) -> None:
        super().__init__(name, *groups, **node_arguments)
        self.worker = ThreadPoolExecutor(1, thread_name_prefix=name)
        self.pairs: Pairing[Experiment, Signal] = Pairing(self._on_pair)
        self.left_out = 0
        # One thread writes each, so that neither needs a lock.
        self._begun = 0
        self._ended = 0

    @property
    def busy(self) -> bool:
        """Whether the thread has something to do."""
        return self._begun > self._ended

    def listen(self) -> None:
        """Begin, once everything is there that `step` needs."""
        self.listens("experiment", self._on_experiment)
        self.listens("signal", self._on_signal)

    def step(self, experiment: Experiment, signal: Signal) -> None:
        """Deal with one experiment; a node's own."""
        raise NotImplementedError

    def _on_experiment(self, message: Any) -> None:
        experiment = from_message("experiment", message)
        # What the twin refuses and tells of must not wait here for its corrected successor.
        if self.machine.may_have_made(experiment):
            self.pairs.left(experiment.number, experiment)

    def _on_signal(self, message: Any) -> None:
        signal = from_message("signal", message)
        self.pairs.right(signal.experiment, signal)

    def _on_pair(self, experiment: Experiment, signal: Signal) -> None:
        if self._begun - self._ended > self.waiting:
            self.left_out += 1
        elif signal.level is Level.POSITIVE or self.busy:
            self._begun += 1
            self.worker.submit(self._step_on_thread, experiment, signal)
        else:
            self.step(experiment, signal)

    def _step_on_thread(self, experiment: Experiment, signal: Signal) -> None:
        try:
            self.step(experiment, signal)
        except LdtError as error:
            self.reject("signal", error)
        except Exception as error:  # would be lost in the thread's future
            self.failure = error
        finally:
            self._ended += 1
