"""A paired node some of whose work takes long."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment, Level
from ldt_core.twin.stage import Archive, RecordedStep
from ldt_ros.nodes.paired_node import PairedNode

NEWS = 0.2  # s, how soon the end of a run learns that nothing waits any more


class WorkerNode(PairedNode):
    """Does what takes long on a thread of its own, so that health is told meanwhile.

    What comes then waits for it there; what is done at its place in `PairedNode`'s table:

    | received | what happens |
    |---|---|
    | an experiment and its `signal` | `step` of both, which takes long at a positive |
    | more than `waiting` (100) while one takes long | the newest is left out and counted |
    """

    #: Experiments that may wait for one that takes long.
    waiting: ClassVar[int] = 100
    #: Whether the end of a run waits for the last experiment to be dealt with here.
    awaited: ClassVar[bool] = False
    #: Topic of which a record, if any, ends its work on an experiment.
    answers: ClassVar[str]

    def __init__(self, name: str, *groups: str, **node_arguments: Any) -> None:
        super().__init__(name, *groups, **node_arguments)
        self.worker = ThreadPoolExecutor(1, thread_name_prefix=name)
        self.left_out = 0
        #: Number of the last experiment that nothing is left to do about.
        self.finished_with = 0
        self._told_last = 0
        # One thread writes each, so that neither needs a lock.
        self._begun = 0
        self._ended = 0
        if self.awaited:
            self.create_timer(NEWS, self._tell_progress, clock=self.steady)

    def health(self) -> dict[str, Any]:
        """What was left out because too much waited, and what `PairedNode` counts."""
        return {"dropped": self.left_out, **super().health()}

    @property
    def busy(self) -> bool:
        """Whether the thread has something to do."""
        return self._begun > self._ended

    @functools.cached_property
    def answered(self) -> int:
        """The last experiment of which the answer, if any, is recorded."""
        return max(self.known, self.last_recorded(self.answers, self.known))

    def deal(self, number: int, work: Callable[[], None], long: bool) -> None:
        """Do the work on an experiment in its turn: on the thread where it, or one before, is long.

        Raises:
            LdtError: whatever work that is not long raises.
        """
        if self._begun - self._ended > self.waiting:
            self.left_out += 1
        elif long or self.busy:
            self._begun += 1
            self.worker.submit(self._on_thread, number, work)
        else:
            self.in_turn(number)
            work()
            self.finished_with = number

    def pair(self, experiment: Experiment, beside: Any) -> None:
        """Deal with one experiment, at a positive on the thread."""
        work = functools.partial(self._whole, experiment, beside)
        self.deal(experiment.number, work, beside.level is Level.POSITIVE)

    def step(self, experiment: Experiment, beside: Any) -> None:
        """What takes long at a positive; a node's own."""
        raise NotImplementedError

    def take_up(self, step: RecordedStep) -> None:
        """Be as after a recorded step."""
        super().take_up(step)
        self.finished_with = self.last

    def return_to(self, state: Mapping[str, Any], archive: Archive) -> None:
        """Take back a state."""
        super().return_to(state, archive)
        self.finished_with = self.last

    def _whole(self, experiment: Experiment, beside: Any) -> None:
        self.step(experiment, beside)
        self.passed(experiment)

    def _on_thread(self, number: int, work: Callable[[], None]) -> None:
        try:
            self.in_turn(number)
            work()
        except LdtError as error:
            self.reject(self.beside, error)
        except Exception as error:  # would be lost in the thread's future
            self.failure = error
        finally:
            self.finished_with = number
            self._ended += 1

    def _tell_progress(self) -> None:
        if self.finished_with != self._told_last and not self.busy:
            self._told_last = self.finished_with
            self.tell()
