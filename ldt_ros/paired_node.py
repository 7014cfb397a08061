"""A node that deals with each experiment together with what another topic says of it."""

from __future__ import annotations

from typing import Any, ClassVar

from ldt_core.experiment import Experiment
from ldt_core.past import Past
from ldt_ros.convert import from_message
from ldt_ros.node import TwinNode
from ldt_ros.pairing import Pairing


class PairedNode(TwinNode):
    """Calls `pair` with both of one number, in order.

    | received | what happens |
    |---|---|
    | `experiment`, and the topic `beside` it | the two of one number are brought together |
    | one without the other | dropped when 100 newer ones have come, and counted |
    | a number that waits already | dropped and counted: the first one counts |
    | a number that was dealt with | dropped and counted: somebody was started again |
    | anything malformed, or that `pair` refuses | counted, logged once per kind |
    """

    #: Topic whose records have an experiment's number.
    beside: ClassVar[str]

    def __init__(self, name: str, *groups: str, **node_arguments: Any) -> None:
        super().__init__(name, *groups, **node_arguments)
        self.pairs: Pairing[Experiment, Any] = Pairing(self.pair)
        #: Number of the last experiment dealt with.
        self.last = 0

    def listen(self) -> None:
        """Begin, once everything is there that `pair` and `recall` need."""
        for step in self.recorded():
            self.pairs.met(step.experiment.number)
            self.take_up(step)
        self.listens(self.beside, self._on_beside)
        self.listens("experiment", self._on_experiment)

    def pair(self, experiment: Experiment, beside: Any) -> None:
        """Deal with one experiment; a node's own."""
        raise NotImplementedError

    def take_up(self, step: Past) -> None:
        """Be as after a recorded step."""
        self.recall(step)
        self.last = step.experiment.number

    def recall(self, step: Past) -> None:
        """Take over what a recorded step says; a node's own."""
        raise NotImplementedError

    def in_turn(self, number: int) -> None:
        """Be as after the experiment before this one, whoever was started again meanwhile."""
        for step in self.missed(self.last, number):
            self.make_up(step)
        self.last = number

    def make_up(self, step: Past) -> None:
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
        self.pairs.right(getattr(record, "experiment", None) or record.number, record)
