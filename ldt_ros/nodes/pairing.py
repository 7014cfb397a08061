"""Two topics brought together by experiment number: each experiment with what is said of it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from ldt_core.base.bounded import forget_oldest
from ldt_core.base.errors import ExperimentError, RecordingError
from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.recording.message_subject import STAMP_END, TIME_TOLERANCE, agree
from ldt_core.restart.checkpoint import Lookup
from ldt_core.restart.recorded_run import RecordedRun
from ldt_core.twin.stage import RecordedStep
from ldt_ros.nodes.interfaces import from_message, stamp_of
from ldt_ros.nodes.node import LdtNode, NodePart

Left = TypeVar("Left")
Right = TypeVar("Right")

#: Twice what a topic keeps, which comes at once after its publisher was cut off: what waits longer
#: has lost its other half.
CAPACITY = 200


class Pairing(Generic[Left, Right]):
    """Calls back with both halves of a number, whichever comes first; bounded.

    Args:
        callback: receives (left, right) once per number.
        capacity: halves of one side that may wait; beyond, the oldest is dropped.

    Attributes:
        dropped: halves that were dropped: too long without the other, or of a number that waits
            already (the first of a number is the one that the twin predicts).
        repeated: halves of a number that has met already: somebody was started again, and says
            once more what may not have been heard.
    """

    def __init__(self, callback: Callable[[Left, Right], None], capacity: int = CAPACITY) -> None:
        self.callback = callback
        self.capacity = capacity
        self.dropped = self.repeated = 0
        self._met: dict[int, float | None] = {}  # the last ones, and their times
        self._left: dict[int, tuple[Left, float | None]] = {}
        self._right: dict[int, tuple[Right, float | None]] = {}

    def __len__(self) -> int:
        """Halves that wait."""
        return len(self._left) + len(self._right)

    def left(self, number: int, item: Left, time: float | None = None) -> None:
        """Take in a left half; its time, if known, tells it from an earlier one of its number."""
        if self._is_repeated(number, time):
            return
        if number in self._right:
            right, _ = self._right.pop(number)
            self._meet(number, item, right, time)
        else:
            self._wait(self._left, number, (item, time))

    def right(self, number: int, item: Right, time: float | None = None) -> None:
        """Take in a right half; its time as of `left`."""
        if self._is_repeated(number, time):
            return
        if number in self._left:
            left, own = self._left.pop(number)
            self._meet(number, left, item, own)
        else:
            self._wait(self._right, number, (item, time))

    def overtaken(self) -> list[tuple[int, float | None]]:
        """Right halves, number and time, of which a later left half has come already."""
        newest = max(self._left, default=0)
        return [(number, time) for number, (_, time) in self._right.items() if number < newest]

    def met(self, number: int, time: float | None = None) -> None:
        """Take what comes of a number, and has this time, for a repetition from now on."""
        self._met.pop(number, None)
        self._met[number] = time
        forget_oldest(self._met, self.capacity)

    def _meet(self, number: int, left: Left, right: Right, time: float | None) -> None:
        self.met(number, time)
        self.callback(left, right)

    def _is_repeated(self, number: int, time: float | None) -> bool:
        """A counter that began anew comes by a number again, at another time."""
        if number not in self._met:
            return False
        known = self._met[number]
        if time is not None and known is not None and abs(time - known) > TIME_TOLERANCE:
            return False
        self.repeated += 1
        return True

    def _wait(self, side: dict[int, Any], number: int, item: Any) -> None:
        if number in side:
            self.dropped += 1
            return
        side[number] = item
        self.dropped += forget_oldest(side, self.capacity)


class ExperimentPairs(NodePart):
    """Calls back with both of one number.

    | received | what happens |
    |---|---|
    | `experiment`, and the topic `beside` it | the two of one number are brought together |
    | a later `experiment` than that of the one beside it | that is read from the recording |
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
        folder = node.settings["resume"] or node.settings["bag"]
        self._run = RecordedRun(folder, node.get_namespace(), node.machine)
        self._sought: dict[tuple[int, float | None], None] = {}  # in the recording, the last ones

    def listen(self) -> None:
        """Begin, once everything is there that the callback needs."""
        self._node.topics.listens(self._beside, self._on_beside)
        self._node.topics.listens("experiment", self._on_experiment)

    def met(self, step: RecordedStep) -> None:
        """Take what comes of a recorded step for a repetition from now on."""
        self.pairing.met(step.number, step.experiment.end)

    def health(self) -> dict[str, Any]:
        """What never found its other half, and what came again."""
        return {"unpaired": self.pairing.dropped, "repeated": self.pairing.repeated}

    def _on_experiment(self, message: Any) -> None:
        experiment = from_message("experiment", message)
        # What the twin refuses and tells of must not wait here for its corrected successor.
        if self._node.machine.may_have_made(experiment):
            self.pairing.left(experiment.number, experiment, _sayable(experiment.end))
        self._find_overtaken()

    def _on_beside(self, message: Any) -> None:
        record = from_message(self._beside, message)
        stamp = stamp_of(message)
        end = stamp
        if isinstance(record, Prediction):
            end = record.start + len(record) * record.period
        self.pairing.right(record.number, (record, stamp), end)
        self._find_overtaken()

    def _find_overtaken(self) -> None:
        """Read from the recording, once each, what can no longer be heard.

        Experiments come in their order, and a topic keeps its last 100: whoever stood still for
        longer lacks some, for which the twin would wait in vain.
        """
        for about in self.pairing.overtaken() if self._run.path else ():
            if about in self._sought:
                continue
            self._sought[about] = None
            forget_oldest(self._sought, CAPACITY)
            with contextlib.suppress(RecordingError, OSError):  # the twin goes on without it
                bag = self._run.bag(listed=True)
                if bag is not None:
                    found = Lookup(bag, self._node.machine, self._node.settings, ()).sent(*about)
                    self.pairing.left(found.number, found, _sayable(found.end))

    def _together(self, experiment: Experiment, beside: tuple[Any, float | None]) -> None:
        """Deal with the two, unless they are of two machines that count alike."""
        record, stamp = beside
        said, own = stamp, experiment.end
        if isinstance(record, Prediction):
            said, own = record.start, experiment.start
        if said is not None and not agree(said, own):
            what = f"{self._beside} of experiment {experiment.number}"
            raise ExperimentError(what, f"the time {own:.3f} s, as the experiment's", f"{said:.3f}")
        self._callback(experiment, record)


def _sayable(time: float) -> float | None:
    """A time that stamps can say, else None."""
    return time if 0 < time < STAMP_END else None
