"""How long a search for causes waits after others that explained nothing."""

from __future__ import annotations

from collections.abc import Sequence

from ldt_core.detectors.adequacy import NEWS

#: Experiments that a search waits at most. Each waits twice as long as the last one that failed, so
#: that few experiments of a machine that nothing explains pay for one (exponential backoff). The
#: detector waits alike where nothing is adopted; where a rival is, only the detector begins anew.
LONGEST = 64


class SearchBackoff:
    """Counts down to the next search.

    Attributes:
        wait: experiments until the next search.
        last: from the last failed one.
        error: largest that a failed one was made on [rad/s], since one was explained.
    """

    def __init__(self) -> None:
        self.wait = self.last = 0
        self.error = 0.0

    @property
    def due(self) -> bool:
        """Whether a search may be made now."""
        return self.wait == 0

    def saw(self, explained: bool, error: float) -> None:
        """One experiment; causes that explain it, or `NEWS` times the error, end the waiting.

        Args:
            explained: by causes that are known; what a flexible model explains still has none.
            error: root mean square of the version in force [rad/s].
        """
        if explained or error >= NEWS * self.error:
            self.wait, self.last, self.error = 0, 0, 0.0 if explained else self.error
        self.wait = max(self.wait - 1, 0)

    def failed(self, error: float) -> None:
        """A search on an experiment of this error [rad/s] explained nothing."""
        self.wait = self.last = min(max(2 * self.last, 1), LONGEST)
        self.error = max(self.error, error)

    def state(self) -> list[float]:
        """For `return_to`."""
        return [self.wait, self.last, self.error]

    def return_to(self, state: Sequence[float]) -> None:
        """Take back a state."""
        wait, last, self.error = state
        self.wait, self.last = int(wait), int(last)
