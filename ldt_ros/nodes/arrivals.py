"""Whether experiments come as they are expected: in time, and none left out."""

from __future__ import annotations

import time
from collections.abc import Callable

from ldt_core.recording.experiment_numbers import ExperimentNumbers
from ldt_ros.nodes.node_part import NodePart

#: Stretches of numbers without a gap that are remembered.
STRETCHES = 1000


class Arrivals(NodePart):
    """The numbers of the experiments that have come, and when the last did.

    By a clock, not by the middleware's deadline: whoever asks for that is not matched by a machine
    that promises none, and hears nothing more of it once the publisher has gone.

    Args:
        deadline: longest time from one to the next [s]; 0 expects nothing.
        clock: of the time that passes [s].
    """

    def __init__(self, deadline: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.deadline, self._clock = deadline, clock
        #: How often none came in time.
        self.overdue = 0
        self._numbers = ExperimentNumbers()
        self._since = clock()
        self._told = False

    def came(self, number: int) -> None:
        """One has come, whatever becomes of it."""
        self._since, self._told = self._clock(), False
        self.known(number)

    def known(self, number: int) -> None:
        """One is not missing: it has come, or is recorded."""
        if len(self._numbers.spans) < STRETCHES:
            self._numbers.add(number)

    def newly_overdue(self) -> bool:
        """Whether one has been awaited for too long, and this has not been said yet."""
        late = 0 < self.deadline < self._clock() - self._since
        if not late or self._told:
            return False
        self._told = True
        self.overdue += 1
        return True

    @property
    def missing(self) -> int:
        """Numbers that were left out so far."""
        return sum(last - first + 1 for first, last in self._numbers.gaps)

    def health(self) -> dict[str, int]:
        """For `/diagnostics`."""
        return {"missing": self.missing, "overdue": self.overdue}

    def complaint(self) -> str:
        """What is to be said of it now; "" when all is well."""
        found = []
        if self._told:
            waited = self._clock() - self._since
            found.append(f"no experiment for {waited:.0f} s, one is due every {self.deadline:g} s")
        if gaps := self._numbers.gaps:
            first, last = gaps[-1]
            which = f"{first}" if first == last else f"{first} to {last}"
            found.append(f"{self.missing} experiments are missing, last {which}")
        return "; ".join(found)
