"""How long a search for causes waits after others that explained nothing."""

from __future__ import annotations

from collections.abc import Sequence

#: Experiments that a search waits at most. Each waits twice as long as the last one that failed, so
#: that few experiments of a machine that nothing explains pay for one (exponential backoff). The
#: detector waits alike where nothing is adopted; where a rival is, only the detector begins anew.
LONGEST = 64


class SearchBackoff:
    """Counts down to the next search.

    Attributes:
        wait: experiments until the next search.
        last: from the last failed one.
    """

    def __init__(self) -> None:
        self.wait = self.last = 0

    @property
    def due(self) -> bool:
        """Whether a search may be made now."""
        return self.wait == 0

    def saw(self, explained: bool) -> None:
        """One experiment; what explains it ends the waiting."""
        self.wait = 0 if explained else max(self.wait - 1, 0)
        self.last = 0 if explained else self.last

    def failed(self) -> None:
        """A search explained nothing."""
        self.wait = self.last = min(max(2 * self.last, 1), LONGEST)

    def state(self) -> list[int]:
        """For `return_to`."""
        return [self.wait, self.last]

    def return_to(self, state: Sequence[int]) -> None:
        """Take back a state."""
        self.wait, self.last = (int(n) for n in state)
