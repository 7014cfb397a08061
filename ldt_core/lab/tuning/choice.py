"""The choice: the least error among the settings that keep to the budget."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.base.errors import OptionError
from ldt_core.base.sentences import counted
from ldt_core.lab.tuning.candidates import NEVER
from ldt_core.lab.tuning.trial import Tried

#: Errors that differ less are the same; then fewer adaptations are better.
SAME_ERROR = 0.01
#: Parts of the recording, each of which is predicted with the setting that the others choose.
PARTS = 5


@dataclass(frozen=True)
class Budget:
    """What the user allows.

    Args:
        adaptations: most adaptations over the recording; None: any number.
        every: at most one false alarm in so many experiments in control; None: any number.

    Raises:
        OptionError: neither is stated.
    """

    adaptations: int | None = None
    every: float | None = None

    def __post_init__(self) -> None:
        if self.adaptations is None and self.every is None:
            expected = "a budget: --adaptations 10, --false-alarms-every 100, or both"
            raise OptionError("--adaptations or --false-alarms-every", expected, "neither")

    def kept(self, tried: Tried) -> bool:
        """Whether a setting keeps to it."""
        if self.adaptations is not None and tried.adaptations > self.adaptations:
            return False
        if self.every is None:
            return True
        return tried.false_alarms is not None and tried.false_alarms.keep(self.every)

    def excess(self, tried: Tried) -> float:
        """How far beyond it a setting is, in factors of e; 0 within."""
        far = 0.0
        if self.adaptations is not None and tried.adaptations:
            far += max(0.0, math.log(tried.adaptations / self.adaptations))
        alarms = tried.false_alarms
        if self.every is not None and alarms is not None and not alarms.keep(self.every):
            least = alarms.high
            if alarms.law is not None:
                least = min(least, max(alarms.law, alarms.rate))
            far += max(0.0, math.log(least * self.every))
        return far

    @property
    def text(self) -> str:
        """For a person."""
        parts = []
        if self.adaptations is not None:
            parts.append(f"at most {counted(self.adaptations, 'adaptation')}")
        if self.every is not None:
            parts.append(f"at most one false alarm in {self.every:g} experiments")
        return " and ".join(parts)


@dataclass(frozen=True)
class TuningChoice:
    """What was chosen, and how much it can be relied on.

    Attributes:
        chosen: the setting; None when none keeps to the budget.
        nearest: to the budget, where nothing was chosen.
        kept: the settings that keep to it.
        tied: those of them whose error is the same as the least.
        checked: MME when each part of the recording is predicted with the setting that the other
            parts choose [rad/s]; None when nothing was chosen.
    """

    chosen: Tried | None
    nearest: Tried | None
    kept: tuple[Tried, ...]
    tied: tuple[Tried, ...]
    checked: float | None


def choose(tried: Sequence[Tried], budget: Budget) -> TuningChoice:
    """The setting with the least MME of those that keep to the budget, see `Choice`.

    A detector that never acts keeps every budget; it is what others are compared with, no choice.
    """
    acting = [t for t in tried if t.setting != NEVER]
    kept = tuple(t for t in acting if budget.kept(t))
    if not kept:
        nearest = min(acting, key=lambda t: (budget.excess(t), t.mme))
        return TuningChoice(None, nearest, (), (), None)
    every = np.ones(len(kept[0].max_error), dtype=bool)
    chosen, tied = _least(kept, every)
    held: list[float] = []
    for part in np.array_split(np.arange(every.size), PARTS):
        rest = every.copy()
        rest[part] = False
        other, _ = _least(kept, rest)
        held += [other.max_error[i] for i in part]
    return TuningChoice(chosen, None, kept, tied, float(np.mean(held)))


def best_of(some: Sequence[Tried]) -> Tried | None:
    """The one that would be chosen of these; None of none."""
    return _least(some, np.ones(len(some[0].max_error), dtype=bool))[0] if some else None


def pareto(tried: Sequence[Tried]) -> list[Tried]:
    """Those that no other beats in both adaptations and MME, by adaptations."""
    front: list[Tried] = []
    for t in sorted(tried, key=lambda t: (t.adaptations, t.mme)):
        if not front or t.mme < front[-1].mme:
            front.append(t)
    return front


def _least(some: Sequence[Tried], mask: np.ndarray) -> tuple[Tried, tuple[Tried, ...]]:
    errors = [float(np.mean(np.array(t.max_error)[mask])) for t in some]
    limit = min(errors) * (1 + SAME_ERROR)
    tied = [(t, e) for t, e in zip(some, errors, strict=True) if e <= limit]
    first = min(tied, key=lambda pair: (pair[0].adaptations, pair[0].positives, pair[1]))
    return first[0], tuple(t for t, _ in tied)
