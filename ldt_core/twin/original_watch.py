"""Whether the original would have erred less than what learns, in the last experiments.

The two are experts, of whom the one is followed that erred less lately ("follow the leader"; N.
Cesa-Bianchi, G. Lugosi, "Prediction, Learning, and Games", Cambridge 2006). What learns is judged
while the original is in force, too: by the version that would be. Were it judged by nothing then,
each time that it came back would cost as much again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from typing import Any

#: Experiments over which the twin is compared with the original, and the least of them.
COMPARED, LEAST_COMPARED = 10, 5
#: Sum of the twin's errors over the original's, above which the original comes back.
WORSE = 1.1


class OriginalWatch:
    """Compares the largest errors of what learns with those that the original would have had.

    Attributes:
        errors: of what learns and the original [rad/s] in the last experiments.
        withdrawn: versions that the original took the place of. What erred more over several
            experiments may err less in one by luck: such a version returns only where it explains.
    """

    def __init__(
        self, errors: Iterable[tuple[float, float]] = (), withdrawn: Iterable[int] = ()
    ) -> None:
        self.errors, self.withdrawn = deque(errors, COMPARED), set(withdrawn)

    def saw(self, learning: float, original: float) -> None:
        """Largest errors [rad/s] in one more experiment."""
        self.errors.append((learning, original))

    def withdraw(self, version: int) -> None:
        """The original has taken the place of a version."""
        self.withdrawn.add(version)

    def state(self) -> dict[str, Any]:
        """In JSON types."""
        return {"errors": list(self.errors), "withdrawn": sorted(self.withdrawn)}

    @classmethod
    def of(cls, state: Mapping[str, Any]) -> OriginalWatch:
        """The one that said this of its state."""
        errors = [(float(twin), float(original)) for twin, original in state["errors"]]
        return cls(errors, map(int, state["withdrawn"]))

    @property
    def trails(self) -> bool:
        """Whether what learns was worse than the original for long."""
        if len(self.errors) < LEAST_COMPARED:
            return False
        learning, original = map(sum, zip(*self.errors, strict=True))
        return learning > WORSE * original

    @property
    def worse(self) -> bool:
        """Whether it also is now."""
        now, first = self.errors[-1]
        return now > first and self.trails

    @property
    def why(self) -> str:
        """What speaks for the original, in words."""
        return f"erred less over {len(self.errors)} experiments"

    @property
    def worse_now(self) -> bool:
        """Whether it was in the last experiment, by as much as it may be over several."""
        now, first = self.errors[-1]
        return now > WORSE * first
