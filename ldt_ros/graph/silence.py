"""Which processes tell nothing of themselves any more, though they live."""

from __future__ import annotations

import statistics
import time
from collections.abc import Mapping

#: Longest time between two looks that counts [s]; beyond that this process has slept itself.
MAX_LOOK_INTERVAL = 0.5
#: Times as silent as the others' median, above which it is the process and not a busy computer.
OUTLIER_RATIO = 3.0
#: Times as silent as is taken for hung, above which it is whatever the others do.
CERTAIN_RATIO = 10.0


class Silence:
    """How long each process of a graph has told nothing."""

    def __init__(self) -> None:
        self._of: dict[str, tuple[int, float]] = {}  # process → statements, time since the last [s]
        self._looked_at = time.monotonic()

    def look(self, told: Mapping[str, int]) -> None:
        """Note how often each process that runs has told something so far."""
        now = time.monotonic()
        passed, self._looked_at = min(now - self._looked_at, MAX_LOOK_INTERVAL), now
        for name, count in told.items():
            before, silence = self._of.get(name, (0, 0.0))
            self._of[name] = count, (silence + passed if count == before else 0.0)

    def told(self, name: str) -> int:
        """How often a process had told something when it was looked at last."""
        return self._of.get(name, (0, 0.0))[0]

    def hung(self, name: str, after: float) -> bool:
        """Whether a process is to be taken for hung.

        Where all are silent, the machine has more to do than it can, and to start one of them again
        would make it worse.

        Args:
            name: of the process.
            after: silence that is too long [s].
        """
        others = [silence for n, (_, silence) in self._of.items() if n != name]
        usual = statistics.median(others) if others else 0.0
        return self._of[name][1] > max(after, min(OUTLIER_RATIO * usual, CERTAIN_RATIO * after))

    def forgive(self, name: str) -> None:
        """Begin anew with a process that ends."""
        self._of[name] = self.told(name), 0.0
