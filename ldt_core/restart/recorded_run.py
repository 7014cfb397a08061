"""What a recording has of one machine's run, read from its beginning or near an experiment."""

from __future__ import annotations

import contextlib
import itertools
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ldt_core.base.errors import LdtError, RecordingError
from ldt_core.machine.machine_file import Machine
from ldt_core.recording.bag import Bag
from ldt_core.recording.experiment_numbers import number_of
from ldt_core.recording.step_search import ANCHOR, StepSearch
from ldt_core.recording.storage import Storage
from ldt_core.restart.recorded_steps import complete_steps
from ldt_core.twin.stage import WINDOW, RecordedStep

#: In place of an experiment's number: the last one, whichever it is.
END = sys.maxsize
#: Ranges of numbers, which may have gaps, that are searched for `WINDOW` steps.
REACHES = (WINDOW, 8 * WINDOW)
#: Time after which a recording that could not be read is tried again [s].
MENDING = 0.3


@dataclass(frozen=True)
class RecordedRun:
    """The run of one machine in a recording that may not exist yet, or be written at this moment.

    Args:
        path: folder of the recording.
        namespace: of the machine, "/" for the root.
        machine: what it cannot have made was refused, whatever its number.
    """

    path: str | Path
    namespace: str
    machine: Machine

    def bag(self, listed: bool = False) -> Bag | None:
        """The recording, None where nothing of the machine was recorded yet.

        Raises:
            RecordingError: what stands there is no recording, or none that can be read.
        """
        if not Path(self.path).exists():
            return None
        storage = Storage(self.path, listed)
        name = self.namespace.strip("/")
        absolute = f"/{name}" if name else ""
        return Bag(storage, absolute) if f"{absolute}/experiment" in storage.topics else None

    def steps(self, around: int = 0) -> Iterator[RecordedStep]:
        """Complete steps; none where nothing of the machine was recorded yet.

        Args:
            around: number of an experiment, or `END`. Reading begins at least `WINDOW` steps before
                it, which takes as long in a long recording as in a short one. Where that place
                cannot be found, all steps are read.
        """
        tail = self._tail(around) if around > WINDOW else None
        if tail is not None:
            yield from tail
            return
        bag = self.bag()
        if bag is not None:
            yield from complete_steps(bag, self.machine)

    def last_of(self, topic: str, around: int = 0) -> int:
        """The last experiment that a record of a topic is about or is, 0 if there is none.

        Args:
            around: as of `steps`; what was recorded before that place does not count.
        """
        if around > WINDOW:
            with contextlib.suppress(LdtError, OSError):
                return self._last_around(topic, around)
        bag = self.bag()
        return last_in(bag, topic) if bag is not None and bag.topic(topic) else 0

    def _tail(self, around: int) -> Iterator[RecordedStep] | None:
        """None where such a place cannot be found.

        Enough steps come before that experiment that what may be left out there, or be told late,
        has no say in what follows.
        """
        for again in (True, False):
            try:
                return self._steps_around(around)
            except (LdtError, OSError):  # its recorder may be mending it at this moment
                if again:
                    time.sleep(MENDING)
        return None  # whoever reads all of it says what is wrong, or reads on behind it

    def _steps_around(self, around: int) -> Iterator[RecordedStep] | None:
        bag = self.bag(listed=True)
        if bag is None or bag.topic(ANCHOR) is None:
            return None
        search = StepSearch(bag)
        if around == END:
            last = search.near_end()
            around = last.number if last else 0
        for reach in REACHES:
            done = around - reach - 1
            if done <= WINDOW:
                return None
            begin = search.begin(search.of_number(done - WINDOW))
            steps = complete_steps(bag, self.machine, begin, done)
            before = list(itertools.islice(steps, WINDOW))
            if len(before) == WINDOW and before[-1].number < around:
                return itertools.chain(before, steps)
        return None

    def _last_around(self, topic: str, around: int) -> int:
        bag = self.bag(listed=True)
        if bag is None:
            return 0
        search = StepSearch(bag)
        last = search.near_end()
        if last is None:
            raise RecordingError(bag.path, "steps", "none")
        number = min(around, last.number)
        if bag.topic(topic) is None:
            return 0
        begin = search.begin(search.of_number(number - WINDOW))
        raws = bag.messages(topic, begin=begin)
        return max((number_of(raw.topic, raw.kind, raw.data) or 0 for raw in raws), default=0)


def last_in(bag: Bag, topic: str) -> int:
    """The last experiment that a record of a topic is about or is, in a recording that has it."""
    raws = bag.storage.picked([bag.topic(topic) or ""])
    return max((number_of(raw.topic, raw.kind, raw.data) or 0 for raw in raws), default=0)
