"""Which positives of a run meet true drifts, by the paper's rule: recall and precision."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

#: "Within the next five experiments after the drift" (paper, section 4). A drift at i means that
#: experiment i is the first with the new value, so the drift took place before it, and the five are
#: i, i+1, …, i+4: its own experiment counts.
DETECTION_WINDOW = 5


@dataclass(frozen=True)
class Detection:
    """How the positives of a run meet the true drifts, by the paper's rule.

    Attributes:
        drifts: number of drifts.
        detected: drifts with a positive within the window.
        positives: number of positives.
        revealing: positives that were the first within the window of a drift.
    """

    drifts: int
    detected: int
    positives: int
    revealing: int

    @property
    def recall(self) -> float | None:
        """Share of drifts detected; None without drifts."""
        return self.detected / self.drifts if self.drifts else None

    @property
    def precision(self) -> float | None:
        """Share of positives that reveal a drift; None without positives."""
        return self.revealing / self.positives if self.positives else None


def detection(drifts: Iterable[int], positives: Iterable[int]) -> Detection:
    """Match positives with drifts.

    A drift at i is detected by a positive in i, …, i + `DETECTION_WINDOW` - 1. The first of these
    reveals it; a later one tells nothing new and counts as an alarm like any other, so that a
    detector cannot buy precision by repeating itself. Windows that overlap may share a positive.

    Args:
        drifts: numbers of the experiments that are the first with a new value (`drifts_of`).
        positives: numbers of the experiments whose signal was positive.

    >>> detection(drifts=[10, 50], positives=[14, 30, 55])
    Detection(drifts=2, detected=1, positives=3, revealing=1)
    """
    true, alarms = set(drifts), set(positives)
    found = delays(true, alarms)
    revealing = {drift + delay for drift, delay in found.items()}
    return Detection(len(true), len(found), len(alarms), len(revealing))


def delays(
    drifts: Iterable[int], positives: Iterable[int], window: int = DETECTION_WINDOW
) -> dict[int, int]:
    """Drift → experiments until its first positive, of the drifts detected within the window.

    >>> delays(drifts=[10, 50], positives=[10, 12, 53])
    {10: 1, 50: 4}
    """
    alarms = sorted(set(positives))
    first = {i: next((a for a in alarms if i <= a < i + window), None) for i in sorted(set(drifts))}
    return {i: a - i + 1 for i, a in first.items() if a is not None}


def drifts_of(values: Sequence[float], first: int = 1) -> list[int]:
    """Numbers of the experiments whose value differs from that of the one before.

    Args:
        values: the wearing parameter in each experiment.
        first: number of the first experiment.

    >>> drifts_of([0.0, 0.0, 0.1, 0.1, 0.3])
    [3, 5]
    """
    pairs = enumerate(itertools.pairwise(values), start=first + 1)
    return [number for number, (old, new) in pairs if new != old]
