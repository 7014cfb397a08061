"""A claim, and how an interval decides it.

The rule is the same everywhere: a claim says that some figure lies on one side of a bound (a
difference above 0, a share below one half). With the whole 95 % interval on the claim's side it is
confirmed, with the whole interval on the other side it is not, and else the seeds leave it
undecided. A claim of several parts ("under every detector") holds when all of them hold, which
needs no correction for their number; one part on the other side is enough against it, and with many
parts that is easier come by, so the evidence names them.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ldt_core.base.sentences import number
from ldt_core.lab.study.evidence import Evidence
from ldt_core.lab.study.statistics import Interval

MOST_LISTED = 6  # parts that a sentence can still list one by one


class ClaimVerdict(enum.StrEnum):
    """What the study says to a claim of the paper; to an aim of our own: met, missed."""

    CONFIRMED = "confirmed"
    NOT_CONFIRMED = "not confirmed"
    UNDECIDED = "undecided"
    NOT_EXAMINED = "not examined"
    MET = "met"
    MISSED = "missed"


AS_AIM = {
    ClaimVerdict.CONFIRMED: ClaimVerdict.MET,
    ClaimVerdict.NOT_CONFIRMED: ClaimVerdict.MISSED,
}


@dataclass(frozen=True)
class ClaimPart:
    """One figure that a claim stands on.

    Args:
        label: what it is of, "threshold detector".
        estimate: with its interval.
        low: the claim says the figure lies above this.
        high: and below this.
        unit: of the figure.
        inclusive: whether a figure on the bound is on the claim's side ("no more than").
        note: further figures, in words.
    """

    label: str
    estimate: Interval
    low: float = -math.inf
    high: float = math.inf
    unit: str = ""
    inclusive: bool = False
    note: str = ""

    @property
    def verdict(self) -> ClaimVerdict:
        """By the interval alone."""
        e = self.estimate
        if e.value is None:
            return ClaimVerdict.NOT_EXAMINED
        inside = self.low < e.low and e.high < self.high
        if inside or (self.inclusive and self.low <= e.low and e.high <= self.high):
            return ClaimVerdict.CONFIRMED
        below, above = e.high < self.low, e.low > self.high
        if not self.inclusive:  # the bound itself is on the other side, but no width is no evidence
            below |= e.high == self.low > e.low
            above |= e.low == self.high < e.high
        return ClaimVerdict.NOT_CONFIRMED if below or above else ClaimVerdict.UNDECIDED

    @property
    def sentence(self) -> str:
        """Label, figure and interval."""
        text = f"{self.label} {self.estimate.text(self.unit)}".strip()
        return f"{text} ({self.note})" if self.note else text


@dataclass(frozen=True)
class Claim:
    """A claim and what the study says to it.

    Attributes:
        id: short name.
        text: the claim, in our words.
        where: in the paper, or whose aim it is.
        verdict: see `ClaimVerdict`.
        evidence: a sentence with the figures and their intervals.
        numbers: the same figures by name, for a machine: each `Interval.as_dict` and more.
        paper: the paper's own figures, where it prints some.
    """

    id: str
    text: str
    where: str
    verdict: ClaimVerdict
    evidence: str
    numbers: Mapping[str, Any] = field(default_factory=dict)
    paper: Mapping[str, float] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        plain = {n: getattr(self, n) for n in ("id", "text", "where", "evidence")}
        rest = {"numbers": dict(self.numbers), "paper": dict(self.paper)}
        return {**plain, "verdict": str(self.verdict), **rest}


#: What a claim stands on: figures that all have to be on its side, and sentences behind them.
Examine = Callable[[Evidence], Iterable[ClaimPart | str]]


@dataclass(frozen=True)
class Statement:
    """What is claimed, before it is examined.

    Args:
        id: short name.
        text: the claim, in our words.
        where: in the paper, or whose aim it is.
        measure: what the figures are of which the evidence speaks.
        examine: gives the figures of a study, and sentences for the reader behind them.
        paper: the paper's own figures.
        aim: an aim is met or missed, not confirmed.
    """

    id: str
    text: str
    where: str
    measure: str
    examine: Examine
    paper: Mapping[str, float] = field(default_factory=dict)
    aim: bool = False

    def examined(self, evidence: Evidence) -> Claim:
        """The claim with its verdict; of a study without runs for it "not examined"."""
        given = list(self.examine(evidence))
        parts = [p for p in given if isinstance(p, ClaimPart) and p.estimate.value is not None]
        verdict = combined([p.verdict for p in parts])
        verdict = AS_AIM.get(verdict, verdict) if self.aim else verdict
        numbers = {p.label or "mean": {**p.estimate.as_dict(), "unit": p.unit} for p in parts}
        if parts:
            seeds = sorted({p.estimate.count for p in parts})
            few = f"{seeds[0]}" if len(seeds) == 1 else f"{seeds[0]} to {seeds[-1]}"
            figures = f"{self.measure}: {_listed(parts)}. Mean [95 % interval] of {few} streams."
        else:
            figures = "The study has no runs for it."
        words = " ".join([figures, *(s for s in given if isinstance(s, str))]).strip()
        return Claim(self.id, self.text, self.where, verdict, words, numbers, dict(self.paper))


def combined(verdicts: Sequence[ClaimVerdict]) -> ClaimVerdict:
    """Of parts that all have to hold."""
    if not verdicts:
        return ClaimVerdict.NOT_EXAMINED
    if ClaimVerdict.NOT_CONFIRMED in verdicts:
        return ClaimVerdict.NOT_CONFIRMED
    held = all(v is ClaimVerdict.CONFIRMED for v in verdicts)
    return ClaimVerdict.CONFIRMED if held else ClaimVerdict.UNDECIDED


def _listed(parts: Sequence[ClaimPart]) -> str:
    """Figures of all parts with a verdict each where they differ; of many, of the unusual ones."""
    verdicts = [p.verdict for p in parts]
    if len(parts) > MOST_LISTED:
        usual = max(set(verdicts), key=verdicts.count)
        found = sorted(p.estimate.value or 0.0 for p in parts if p.verdict is usual)
        unit = f" {parts[0].unit}" if parts[0].unit else ""
        span = f"{usual} in {len(found)} of {len(parts)} cases, means from {number(found[0])} to "
        rest = [f"{p.sentence}: {p.verdict}" for p in parts if p.verdict is not usual]
        return "; ".join([f"{span}{number(found[-1])}{unit}", *rest])
    if len(set(verdicts)) == 1:
        return "; ".join(p.sentence for p in parts)
    return "; ".join(f"{p.sentence}: {p.verdict}" for p in parts)


def percent(value: float | None) -> str:
    """A share for people.

    >>> percent(0.0953), percent(None)
    ('9.53 %', 'unknown')
    """
    return "unknown" if value is None else f"{number(100 * value)} %"
