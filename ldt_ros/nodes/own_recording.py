"""The recording of the run that a node goes on with when it is started again."""

from __future__ import annotations

import time
from collections.abc import Iterator

from ldt_core.base.errors import RecordingError
from ldt_core.recording.message_subject import Subject
from ldt_core.restart.recorded_run import RecordedRun
from ldt_core.restart.run_key import check_machine
from ldt_core.twin.stage import RecordedStep
from ldt_ros.nodes.watchdog import alive

#: Time after its start in which a node asks the recording for what nobody sends [s].
CATCH_UP_TIME = 60.0
#: Times that it asks for what is not there, since the numbers may have gaps.
VAIN_LOOKS = 3
#: Times that a recording is read which its recorder may be mending at this moment.
TRIES = 6
#: Time between two tries [s].
MENDING = 0.5


class OwnRecording:
    """Empty where the run begins with this node.

    Args:
        run: as it is recorded; with the path "" where the run begins.

    Raises:
        RecordingError: the run began with another machine file.
    """

    def __init__(self, run: RecordedRun) -> None:
        self.run = run
        self._opened_at = time.monotonic()
        self._in_vain = 0
        self._require_same_machine()

    def steps(self, around: int = 0) -> Iterator[RecordedStep]:
        """Complete steps; `around` as one of `RecordedRun.steps`.

        Raises:
            RecordingError: a recording that cannot be read.
        """
        last: Subject | None = None
        for again in reversed(range(TRIES if self.run.path else 0)):
            told = last is None
            try:
                for step in self.run.steps(around if last is None else last[0]):
                    alive()  # a long recording takes longer than a watchdog waits
                    key = step.number, step.experiment.start
                    if told:
                        last = key
                        yield step
                    told = told or key == last
                return
            except (RecordingError, OSError):  # its recorder may be mending it at this moment
                if not again:
                    raise
                time.sleep(MENDING)

    def _require_same_machine(self) -> None:
        """Refuse to go on where the machine file was edited since the run began.

        Of nodes that read it at different times, each would have a machine of its own.
        """
        try:
            bag = self.run.bag(listed=True) if self.run.path else None
        except (RecordingError, OSError):
            return  # whoever reads its messages says what is wrong
        if bag is not None:
            check_machine(bag, self.run.machine)

    def missed(self, last: Subject, number: int) -> Iterator[RecordedStep]:
        """Steps between two, soon after the node was started again.

        What it reads at its start may be older than what another node reads that is started again
        after it: that one goes on from there, and nobody sends what is between.

        Args:
            last: number and start [s] of the experiment dealt with last, (0, 0.0) before any.
            number: of the one that has come.
        """
        soon = time.monotonic() - self._opened_at < CATCH_UP_TIME and self._in_vain < VAIN_LOOKS
        if not (self.run.path and soon and number > last[0] + 1):
            return
        found = False
        for step in self.steps(last[0]):
            # Of a counter that began anew, the same numbers came before.
            if last[0] < step.number < number and step.experiment.start > last[1]:
                found = True
                yield step
            elif found:
                break
        self._in_vain += not found

    def last_of(self, topic: str, around: int = 0) -> Subject:
        """The last experiment that a record of a topic is about, as `RecordedRun.last_of`."""
        return self.run.last_of(topic, around) if self.run.path else (0, 0.0)
