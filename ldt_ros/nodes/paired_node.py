"""A node that deals with each experiment together with what another topic says of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ldt_core.base.errors import ExperimentError
from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.restart.recorded_run import RecordedRun
from ldt_core.restart.recovery import Recovery
from ldt_core.twin.adaptor import ROLLED_BACK
from ldt_core.twin.stage import Archive, RecordedStep, Stage
from ldt_ros.nodes.convert import from_message
from ldt_ros.nodes.feed import stamp_of
from ldt_ros.nodes.node import TwinNode
from ldt_ros.nodes.pairing import Pairing

SAME = 1e-3  # s by which two statements of one time may differ
LATEST = 2.0**31  # s since the epoch, which a stamp can say


class PairedNode(TwinNode):
    """Calls `pair` with both of one number, in order.

    | received | what happens |
    |---|---|
    | `experiment`, and the topic `beside` it | the two of one number are brought together |
    | one without the other | dropped when 200 newer ones have come, and counted |
    | a number that waits already | dropped and counted: the first one counts |
    | a number that was dealt with | dropped and counted: somebody was started again |
    | what says another time than the experiment, of a second machine | both rejected |
    | anything malformed, or that `pair` refuses | counted, logged once per kind |
    """

    #: Topic whose records have an experiment's number.
    beside: ClassVar[str]

    def __init__(self, name: str, *groups: str, **node_arguments: Any) -> None:
        super().__init__(name, *groups, **node_arguments)
        self.pairs: Pairing[Experiment, Any] = Pairing(self._together)
        #: Number of the last experiment dealt with.
        self.last = 0
        #: Number of that after which a checkpoint was made from which this node goes on, or 0.
        self.known = 0

    def listen(self, stage: Stage) -> None:
        """Begin, once everything is there that `pair` and `recall` need.

        Args:
            stage: what comes to know something here, and is brought to where the recording ends.
        """
        self.stage = stage
        resume = self.settings["resume"]
        run = RecordedRun(resume or self.settings["bag"], self.get_namespace(), self.machine)
        self.recovery = Recovery(
            self, self.role, run, self.settings, lambda told: self.get_logger().warning(told)
        )
        self.known = self.recovery.return_to_checkpoint() if resume else 0
        for step in self.recorded(self.known):
            self.pairs.met(step.experiment.number)
            if step.experiment.number > self.known:
                self.take_up(step)
        self.listens(self.beside, self._on_beside)
        self.listens("experiment", self._on_experiment)

    def pair(self, experiment: Experiment, beside: Any) -> None:
        """Deal with one experiment; a node's own."""
        raise NotImplementedError

    def take_up(self, step: RecordedStep) -> None:
        """Be as after a recorded step."""
        self.recall(step)
        self.last = step.experiment.number
        if ROLLED_BACK not in step.adaptation.details:
            self.passed(step.experiment)

    def passed(self, experiment: Experiment) -> None:
        """An experiment has been dealt with for good: keep a checkpoint if it is time."""
        self.recovery.passed(experiment)

    def state(self) -> dict[str, Any] | None:
        """What the stage has come to know, None where it cannot say all."""
        return self.stage.state()

    def return_to(self, state: Mapping[str, Any], archive: Archive) -> None:
        """Take back a state."""
        self.stage.return_to(state, archive)
        self.last = archive.steps[-1].number

    def recall(self, step: RecordedStep) -> None:
        """Take over what a recorded step says."""
        self.stage.recall(step)

    def in_turn(self, number: int) -> None:
        """Be as after the experiment before this one, whoever was started again meanwhile."""
        for step in self.missed(self.last, number):
            self.make_up(step)
        self.last = number

    def make_up(self, step: RecordedStep) -> None:
        """Be as after a step that was missed; where that is more than `take_up`, a node's own."""
        self.take_up(step)

    def health(self) -> dict[str, Any]:
        """What never found its other half, and what came again."""
        return {"unpaired": self.pairs.dropped, "repeated": self.pairs.repeated}

    def _on_experiment(self, message: Any) -> None:
        experiment = from_message("experiment", message)
        # What the twin refuses and tells of must not wait here for its corrected successor.
        if self.machine.may_have_made(experiment):
            self.pairs.left(experiment.number, experiment)

    def _on_beside(self, message: Any) -> None:
        record = from_message(self.beside, message)
        number = getattr(record, "experiment", None) or record.number
        self.pairs.right(number, (record, stamp_of(message)))

    def _together(self, experiment: Experiment, beside: tuple[Any, float | None]) -> None:
        """Deal with the two, unless they are of two machines that count alike."""
        record, stamp = beside
        said, own = stamp, experiment.end
        if isinstance(record, Prediction):
            said, own = record.start, experiment.start
        if said is not None and 0 < own < LATEST and abs(said - own) > SAME:
            what = f"{self.beside} of experiment {experiment.number}"
            raise ExperimentError(what, f"the time {own:.3f} s, as the experiment's", f"{said:.3f}")
        self.pair(experiment, record)
