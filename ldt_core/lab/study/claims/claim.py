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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ldt_core.base.sentences import number
from ldt_core.lab.study.statistics import Estimate

MANY = 6  # parts that a sentence can still list one by one


class Verdict(enum.StrEnum):
    """What the study says to a claim of the paper; to an aim of our own: met, missed."""

    CONFIRMED = "confirmed"
    NOT_CONFIRMED = "not confirmed"
    UNDECIDED = "undecided"
    NOT_EXAMINED = "not examined"
    MET = "met"
    MISSED = "missed"


@dataclass(frozen=True)
class Part:
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
    estimate: Estimate
    low: float = -math.inf
    high: float = math.inf
    unit: str = ""
    inclusive: bool = False
    note: str = ""

    @property
    def verdict(self) -> Verdict:
        """By the interval alone."""
        e = self.estimate
        if e.value is None:
            return Verdict.NOT_EXAMINED
        inside = self.low < e.low and e.high < self.high
        if inside or (self.inclusive and self.low <= e.low and e.high <= self.high):
            return Verdict.CONFIRMED
        below, above = e.high < self.low, e.low > self.high
        if not self.inclusive:  # the bound itself is on the other side, but no width is no evidence
            below |= e.high == self.low > e.low
            above |= e.low == self.high < e.high
        return Verdict.NOT_CONFIRMED if below or above else Verdict.UNDECIDED

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
        verdict: see `Verdict`.
        evidence: a sentence with the figures and their intervals.
        numbers: the same figures by name, for a machine: each `Estimate.as_dict` and more.
        paper: the paper's own figures, where it prints some.
    """

    id: str
    text: str
    where: str
    verdict: Verdict
    evidence: str
    numbers: Mapping[str, Any] = field(default_factory=dict)
    paper: Mapping[str, float] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        plain = {n: getattr(self, n) for n in ("id", "text", "where", "evidence")}
        rest = {"numbers": dict(self.numbers), "paper": dict(self.paper)}
        return {**plain, "verdict": str(self.verdict), **rest}


@dataclass(frozen=True)
class Statement:
    """What is claimed, before it is examined.

    Args:
        id: short name.
        text: the claim, in our words.
        where: in the paper.
        measure: what the figures are of which the evidence speaks.
        paper: the paper's own figures.
    """

    id: str
    text: str
    where: str
    measure: str
    paper: Mapping[str, float] = field(default_factory=dict)

    def examined(self, parts: Sequence[Part], remark: str = "", aim: bool = False) -> Claim:
        """The claim with its verdict.

        Args:
            parts: figures that all have to be on the claim's side.
            remark: a sentence for the reader behind the figures.
            aim: an aim is met or missed, not confirmed.
        """
        known = [p for p in parts if p.estimate.value is not None]
        verdict = combined([p.verdict for p in known])
        if aim:
            as_aim = {Verdict.CONFIRMED: Verdict.MET, Verdict.NOT_CONFIRMED: Verdict.MISSED}
            verdict = as_aim.get(verdict, verdict)
        numbers = {p.label or "mean": {**p.estimate.as_dict(), "unit": p.unit} for p in known}
        if not known:
            evidence = "The study has no runs for it."
        else:
            seeds = sorted({p.estimate.count for p in known})
            few = f"{seeds[0]}" if len(seeds) == 1 else f"{seeds[0]} to {seeds[-1]}"
            evidence = f"{self.measure}: {_listed(known)}. Mean [95 % interval] of {few} streams."
        evidence = f"{evidence} {remark}".strip()
        return Claim(self.id, self.text, self.where, verdict, evidence, numbers, dict(self.paper))


def combined(verdicts: Sequence[Verdict]) -> Verdict:
    """Of parts that all have to hold."""
    if not verdicts:
        return Verdict.NOT_EXAMINED
    if Verdict.NOT_CONFIRMED in verdicts:
        return Verdict.NOT_CONFIRMED
    held = all(v is Verdict.CONFIRMED for v in verdicts)
    return Verdict.CONFIRMED if held else Verdict.UNDECIDED


def _listed(parts: Sequence[Part]) -> str:
    """Figures of all parts with a verdict each where they differ; of many, of the unusual ones."""
    verdicts = [p.verdict for p in parts]
    if len(parts) > MANY:
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
