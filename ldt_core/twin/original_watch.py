"""Whether the original would have erred less than the twin, in the last experiments."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

#: Experiments over which the twin is compared with the original, and the least of them.
COMPARED, LEAST_COMPARED = 10, 5
#: Sum of the twin's errors over the original's, above which the original comes back.
WORSE = 1.1


class OriginalWatch:
    """Compares the largest errors of the twin with those that the original would have had.

    Attributes:
        errors: of the twin and the original [rad/s] in the last experiments.
    """

    def __init__(self, errors: Iterable[tuple[float, float]] = ()) -> None:
        self.errors = deque(errors, COMPARED)

    def saw(self, twin: float, original: float) -> None:
        """Largest errors [rad/s] in one more experiment."""
        self.errors.append((twin, original))

    @property
    def worse(self) -> bool:
        """Whether the twin was worse than the original for long, and is now."""
        if len(self.errors) < LEAST_COMPARED:
            return False
        (now, first), (twin, original) = self.errors[-1], map(sum, zip(*self.errors, strict=True))
        return now > first and twin > WORSE * original

    @property
    def worse_now(self) -> bool:
        """Whether it was in the last experiment, by as much as it may be over several."""
        now, first = self.errors[-1]
        return now > WORSE * first
