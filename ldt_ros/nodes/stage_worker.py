"""A stage of the loop in a node: where its recording ends, then one experiment after the other."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from ldt_core.base.experiment import Experiment
from ldt_core.base.threads import started_thread
from ldt_core.recording.message_subject import Subject, agree
from ldt_core.restart.recorded_run import RecordedRun
from ldt_core.restart.stage_restart import StageRestart
from ldt_core.twin.stage import RecordedStep, Stage
from ldt_ros.nodes.node import LdtNode, NodePart

#: Time between two looks at what is left to do [s], for which the end of a run may wait.
PROGRESS_PERIOD = 0.2


class StageWorker(NodePart):
    """Does what takes long on a thread of its own, so that health is told meanwhile.

    What comes then waits for it there; of more than may wait, the newest is left out and counted.

    Args:
        node: whose role the stage plays.
        stage: that goes on where its recording ends.
        beside: topic whose message is rejected with work that fails on the thread.
        waiting: experiments that may wait for one that takes long.
        awaited: whether the end of a run waits for the last experiment to be dealt with here.
        answers: topic of which a record, if any, ends the work on an experiment.

    Attributes:
        finished_with: number of the last one that nothing is left to do about.
        left_out: experiments that were left out.
        thread: on which the work is done.
    """

    def __init__(
        self,
        node: LdtNode,
        stage: Stage,
        beside: str,
        *,
        waiting: int = 100,
        awaited: bool = False,
        answers: str = "",
    ) -> None:
        self._node, self._beside, self._answers = node, beside, answers
        folder = node.settings["resume"] or node.settings["bag"]
        run = RecordedRun(folder, node.get_namespace(), node.machine)
        self.restart = StageRestart(
            stage, node.role, run, node.settings, lambda told: node.get_logger().warning(told)
        )
        self.waiting = waiting
        self.finished_with = self.left_out = 0
        self._last: Subject = (0, 0.0)  # number and start of the last experiment begun with
        self._make_up: Callable[[RecordedStep], None] | None = None
        self.thread = started_thread(node.role)
        # One thread writes each, so that neither needs a lock.
        self._begun = self._ended = 0
        self._told_last = 0
        if awaited:
            node.create_timer(PROGRESS_PERIOD, self._tell_progress, clock=node.steady)

    def go_to_the_end(
        self,
        met: Callable[[RecordedStep], None],
        again: Callable[[RecordedStep], None] | None = None,
        make_up: Callable[[RecordedStep], None] | None = None,
    ) -> None:
        """Bring the stage to where its recording ends.

        Args:
            met: is told of each recorded step.
            again: begins once more with a step whose answer may have been under way; None recalls.
            make_up: the same where such a step is missed later.
        """
        self._make_up = make_up
        if self._node.settings["resume"]:
            self.finished_with = self.restart.return_to_checkpoint()
        for step in self._node.recording.steps(self.restart.known):
            met(step)
            if self.restart.covers(step):
                self._dealt_with(step.experiment)
            else:
                self._take_over(step, again)

    @functools.cached_property
    def answered(self) -> float:
        """End of the last experiment of which an answer is recorded [s since the epoch]."""
        return self._node.recording.last_of(self._answers, self.restart.known)[1]

    @property
    def pending(self) -> int:
        """Experiments that the thread has to deal with."""
        return self._begun - self._ended

    @property
    def busy(self) -> bool:
        """Whether the thread has something to do."""
        return self.pending > 0

    def health(self) -> dict[str, Any]:
        """What was left out because too much waited."""
        return {"dropped": self.left_out}

    def recall(self, step: RecordedStep) -> None:
        """Take over what a recorded step says."""
        self.restart.recall(step)
        self._dealt_with(step.experiment)
        self.finished_with = step.number

    def deal(self, experiment: Experiment, work: Callable[[], None], long: bool) -> None:
        """Do the work on an experiment in its turn: on the thread where it, or one before, is long.

        Raises:
            Exception: whatever work that is not long raises, or a thread that takes no more.
        """
        if self.pending > self.waiting:
            self.left_out += 1
        elif long or self.busy:
            self.thread.submit(self._on_thread, experiment, work)
            self._begun += 1  # behind it: what the thread did not take would be pending for ever
        else:
            self._in_turn(experiment, work)
            self.finished_with = experiment.number

    def _dealt_with(self, experiment: Experiment) -> None:
        self._last = experiment.number, experiment.start

    def _take_over(self, step: RecordedStep, again: Callable[[RecordedStep], None] | None) -> None:
        end = step.experiment.end
        if again is None or end < self.answered or agree(self.answered, end):
            self.recall(step)
        else:
            again(step)

    def _in_turn(self, experiment: Experiment, work: Callable[[], None]) -> None:
        # Whoever was started again meanwhile, the stage is where the experiment before left it.
        for step in self._node.recording.missed(self._last, experiment.number):
            self._take_over(step, self._make_up)
        self._dealt_with(experiment)
        work()
        self.restart.passed(experiment)

    def _on_thread(self, experiment: Experiment, work: Callable[[], None]) -> None:
        try:
            self._in_turn(experiment, work)
        except BaseException as error:  # would be lost in the thread's future
            self._node.topics.reject(self._beside, error)
        finally:
            self.finished_with = experiment.number
            self._ended += 1

    def _tell_progress(self) -> None:
        if self.finished_with != self._told_last and not self.busy:
            self._told_last = self.finished_with
            self._node.report.tell()
