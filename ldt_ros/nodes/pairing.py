"""Two topics brought together by experiment: each with what is said of it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from typing import Any, Generic, TypeVar

from ldt_core.base.bounded import forget_oldest
from ldt_core.base.errors import RecordingError
from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.recording.message_subject import STAMP_END, TIME_TOLERANCE
from ldt_core.restart.checkpoint import Lookup
from ldt_core.restart.recorded_run import RecordedRun
from ldt_core.twin.stage import RecordedStep
from ldt_ros.nodes.interfaces import from_message, stamp_of
from ldt_ros.nodes.node import LdtNode, NodePart

Left = TypeVar("Left")
Right = TypeVar("Right")

#: Number of an experiment, and its start or end [s since the epoch]; None where that is not known.
About = tuple[int, float | None]

#: Twice what a topic keeps, which comes at once after its publisher was cut off: what waits longer
#: has lost its other half.
CAPACITY = 200


class Pairing(Generic[Left, Right]):
    """Calls back with both halves of an experiment, whichever comes first; bounded.

    A number alone is not enough: a counter that begins anew comes by it again, and what the twin
    refuses meanwhile waits here.

    Args:
        callback: receives (left, right) once per number and time.
        capacity: halves of one side that may wait; beyond, the oldest is dropped.

    Attributes:
        dropped: halves that were dropped: too long without the other, or of an experiment that
            waits already (the first of a number and a time is the one that the twin predicts).
        repeated: halves of an experiment that has met already: somebody was started again, and
            says once more what may not have been heard.
    """

    def __init__(self, callback: Callable[[Left, Right], None], capacity: int = CAPACITY) -> None:
        self.callback = callback
        self.capacity = capacity
        self.dropped = self.repeated = 0
        self._met: dict[About, None] = {}  # the last ones
        self._left: dict[About, Left] = {}
        self._right: dict[About, Right] = {}

    def __len__(self) -> int:
        """Halves that wait."""
        return len(self._left) + len(self._right)

    def left(self, number: int, item: Left, time: float | None = None) -> None:
        """Take in a left half; its time, if known, tells it from another one of its number."""
        about = number, time
        if self._is_repeated(about):
            return
        other = _same(self._right, about)
        if other is None:
            self._wait(self._left, about, item)
        else:
            self._meet(about, item, self._right.pop(other))

    def right(self, number: int, item: Right, time: float | None = None) -> None:
        """Take in a right half; its time as of `left`."""
        about = number, time
        if self._is_repeated(about):
            return
        other = _same(self._left, about)
        if other is None:
            self._wait(self._right, about, item)
        else:
            self._meet(other, self._left.pop(other), item)

    def overtaken(self) -> list[About]:
        """Right halves, number and time, of which a later left half has come already."""
        newest = max((number for number, _ in self._left), default=0)
        return [about for about in self._right if about[0] < newest]

    def met(self, number: int, time: float | None = None) -> None:
        """Take what comes of a number, and has this time, for a repetition from now on."""
        self._met.pop((number, time), None)
        self._met[number, time] = None
        forget_oldest(self._met, self.capacity)

    def _meet(self, about: About, left: Left, right: Right) -> None:
        self.met(*about)
        self.callback(left, right)

    def _is_repeated(self, about: About) -> bool:
        known = _same(self._met, about) is not None
        self.repeated += known
        return known

    def _wait(self, side: dict[About, Any], about: About, item: Any) -> None:
        if _same(side, about) is not None:
            self.dropped += 1
            return
        side[about] = item
        self.dropped += forget_oldest(side, self.capacity)


def _same(among: Iterable[About], about: About) -> About | None:
    """The first among them that is of the same experiment, as far as the times are known."""
    number, time = about
    for other in among:
        known = other[1]
        if other[0] != number:
            continue
        if time is None or known is None or abs(time - known) <= TIME_TOLERANCE:
            return other
    return None


class ExperimentPairs(NodePart):
    """Calls back with both of one experiment, which its number and its time tell from others.

    | received | what happens |
    |---|---|
    | `experiment`, and the topic `beside` it | the two of one experiment are brought together |
    | a later `experiment` than that of the one beside it | that is read from the recording |
    | one without the other | dropped when 200 newer ones have come, and counted |
    | an experiment that waits already | dropped and counted: the first one counts |
    | an experiment that was dealt with | dropped and counted: somebody was started again |
    | a number at another time, which was refused or is of a second machine | waits for its own |
    | anything malformed, or that the node refuses | counted, logged once per kind |

    Args:
        node: that listens, once `listen` is called.
        beside: topic whose records have an experiment's number.
        callback: is called with the experiment and the record beside it.
    """

    def __init__(
        self, node: LdtNode, beside: str, callback: Callable[[Experiment, Any], None]
    ) -> None:
        self._node, self._beside = node, beside
        self.pairing: Pairing[Experiment, Any] = Pairing(callback)
        folder = node.settings["resume"] or node.settings["bag"]
        self._run = RecordedRun(folder, node.get_namespace(), node.machine)
        self._sought: dict[About, None] = {}  # in the recording, the last ones

    def listen(self) -> None:
        """Begin, once everything is there that the callback needs."""
        self._node.topics.listens(self._beside, self._on_beside)
        self._node.topics.listens("experiment", self._on_experiment)

    def met(self, step: RecordedStep) -> None:
        """Take what comes of a recorded step for a repetition from now on."""
        self.pairing.met(step.number, self._time_of(step.experiment))

    def health(self) -> dict[str, Any]:
        """What never found its other half, and what came again."""
        return {"unpaired": self.pairing.dropped, "repeated": self.pairing.repeated}

    def _on_experiment(self, message: Any) -> None:
        experiment = from_message("experiment", message)
        # What the twin refuses and tells of must not wait in its corrected successor's place, which
        # has the same number and start.
        if self._node.machine.may_have_made(experiment):
            self.pairing.left(experiment.number, experiment, self._time_of(experiment))
        self._find_overtaken()

    def _on_beside(self, message: Any) -> None:
        record = from_message(self._beside, message)
        time = record.start if isinstance(record, Prediction) else stamp_of(message)
        self.pairing.right(record.number, record, time)
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
                    self.pairing.left(found.number, found, self._time_of(found))

    def _time_of(self, experiment: Experiment) -> float | None:
        """What the one beside it says of its time: a prediction its start, a stamp its end."""
        return experiment.start if self._beside == "prediction" else _sayable(experiment.end)


def _sayable(time: float) -> float | None:
    """A time that stamps can say, else None."""
    return time if 0 < time < STAMP_END else None
