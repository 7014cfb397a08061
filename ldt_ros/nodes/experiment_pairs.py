"""Each experiment brought together with what another topic says of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ldt_core.base.errors import ExperimentError
from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.twin.stage import RecordedStep
from ldt_ros.nodes.convert import from_message
from ldt_ros.nodes.feed import stamp_of
from ldt_ros.nodes.node import LdtNode
from ldt_ros.nodes.node_part import NodePart
from ldt_ros.nodes.pairing import Pairing

#: Longest time by which two statements of one time may differ [s].
TIME_TOLERANCE = 1e-3
#: First time that a stamp cannot say [s since the epoch].
STAMP_END = 2.0**31


class ExperimentPairs(NodePart):
    """Calls back with both of one number.

    | received | what happens |
    |---|---|
    | `experiment`, and the topic `beside` it | the two of one number are brought together |
    | one without the other | dropped when 200 newer ones have come, and counted |
    | a number that waits already | dropped and counted: the first one counts |
    | a number that was dealt with | dropped and counted: somebody was started again |
    | what says another time than the experiment, of a second machine | both rejected |
    | anything malformed, or that the node refuses | counted, logged once per kind |

    Args:
        node: that listens, once `listen` is called.
        beside: topic whose records have an experiment's number.
        callback: is called with the experiment and the record beside it.
    """

    def __init__(
        self, node: LdtNode, beside: str, callback: Callable[[Experiment, Any], None]
    ) -> None:
        self._node, self._beside, self._callback = node, beside, callback
        self.pairing: Pairing[Experiment, tuple[Any, float | None]] = Pairing(self._together)

    def listen(self) -> None:
        """Begin, once everything is there that the callback needs."""
        self._node.topics.listens(self._beside, self._on_beside)
        self._node.topics.listens("experiment", self._on_experiment)

    def met(self, step: RecordedStep) -> None:
        """Take what comes of a recorded step for a repetition from now on."""
        self.pairing.met(step.number)

    def health(self) -> dict[str, Any]:
        """What never found its other half, and what came again."""
        return {"unpaired": self.pairing.dropped, "repeated": self.pairing.repeated}

    def _on_experiment(self, message: Any) -> None:
        experiment = from_message("experiment", message)
        # What the twin refuses and tells of must not wait here for its corrected successor.
        if self._node.machine.may_have_made(experiment):
            self.pairing.left(experiment.number, experiment)

    def _on_beside(self, message: Any) -> None:
        record = from_message(self._beside, message)
        number = getattr(record, "experiment", None) or record.number
        self.pairing.right(number, (record, stamp_of(message)))

    def _together(self, experiment: Experiment, beside: tuple[Any, float | None]) -> None:
        """Deal with the two, unless they are of two machines that count alike."""
        record, stamp = beside
        said, own = stamp, experiment.end
        if isinstance(record, Prediction):
            said, own = record.start, experiment.start
        if said is not None and 0 < own < STAMP_END and abs(said - own) > TIME_TOLERANCE:
            what = f"{self._beside} of experiment {experiment.number}"
            raise ExperimentError(what, f"the time {own:.3f} s, as the experiment's", f"{said:.3f}")
        self._callback(experiment, record)
