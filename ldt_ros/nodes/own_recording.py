"""The recording of the run that a node goes on with when it is started again."""

from __future__ import annotations

import time
from collections.abc import Iterator

from ldt_core.base.errors import RecordingError
from ldt_core.restart.recorded_run import RecordedRun
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
    """

    def __init__(self, run: RecordedRun) -> None:
        self.run = run
        self._opened_at = time.monotonic()
        self._in_vain = 0

    def steps(self, around: int = 0) -> Iterator[RecordedStep]:
        """Complete steps; `around` as of `RecordedRun.steps`.

        Raises:
            RecordingError: a recording that cannot be read.
        """
        last = 0
        for again in reversed(range(TRIES if self.run.path else 0)):
            try:
                for step in self.run.steps(last or around):
                    if step.number > last:
                        last = step.number
                        alive()  # a long recording takes longer than a watchdog waits
                        yield step
                return
            except (RecordingError, OSError):  # its recorder may be mending it at this moment
                if not again:
                    raise
                time.sleep(MENDING)

    def missed(self, last: int, number: int) -> Iterator[RecordedStep]:
        """Steps between two, soon after the node was started again.

        What it reads at its start may be older than what another node reads that is started again
        after it: that one goes on from there, and nobody sends what is between.
        """
        soon = time.monotonic() - self._opened_at < CATCH_UP_TIME and self._in_vain < VAIN_LOOKS
        if not (self.run.path and soon and number > last + 1):
            return
        found = False
        for step in self.steps(last):
            if step.number >= number:
                break
            if step.number > last:
                found = True
                yield step
        self._in_vain += not found

    def last_of(self, topic: str, around: int = 0) -> int:
        """The last experiment that a record of a topic is about, 0 if there is none."""
        return self.run.last_of(topic, around) if self.run.path else 0
