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
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter

from ldt_core.base.sentences import number
from ldt_core.lab.statistics import Interval
from ldt_core.lab.study.study import BySeed, Evidence, Figure, ScoredRun, over

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
    """

    id: str
    text: str
    where: str
    verdict: ClaimVerdict
    evidence: str


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
        aim: an aim is met or missed, not confirmed.
    """

    id: str
    text: str
    where: str
    measure: str
    examine: Examine
    aim: bool = False

    def examined(self, evidence: Evidence) -> Claim:
        """The claim with its verdict; of a study without runs for it "not examined"."""
        given = list(self.examine(evidence))
        parts = [p for p in given if isinstance(p, ClaimPart) and p.estimate.value is not None]
        verdict = combined([p.verdict for p in parts])
        verdict = AS_AIM.get(verdict, verdict) if self.aim else verdict
        if parts:
            seeds = sorted({p.estimate.count for p in parts})
            few = f"{seeds[0]}" if len(seeds) == 1 else f"{seeds[0]} to {seeds[-1]}"
            many = "stream" if few == "1" else "streams"
            figures = f"{self.measure}: {_listed(parts)}. Mean [95 % interval] of {few} {many}."
        else:
            figures = "The study has no runs for it."
        words = " ".join([figures, *(s for s in given if isinstance(s, str))]).strip()
        return Claim(self.id, self.text, self.where, verdict, words)


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


ACTIVE = ("threshold", "lddm")
PASSIVE = "window"
PAPER_DETECTORS = (*ACTIVE, PASSIVE)


NO_TREND = 0.3  # a rank correlation within this is commonly called none or weak

mme: Callable[[ScoredRun], float] = attrgetter("score.mme")
mme_original: Figure = attrgetter("score.mme_original")
left: Figure = attrgetter("score.share")
adaptations: Callable[[ScoredRun], float] = attrgetter("score.adaptations")
recall: Figure = attrgetter("score.recall")


@dataclass(frozen=True)
class ModelUnderDetector:
    """A model under a detector, in a study."""

    evidence: Evidence
    model: str
    detector: str

    @property
    def runs(self) -> BySeed:
        """Its runs in the paper's group."""
        return self.evidence.runs(self.model, self.detector)

    def beside(self, model: str = "", detector: str = "") -> BySeed:
        """The runs of another model under this detector, or of this one under another."""
        return self.evidence.runs(model or self.model, detector or self.detector)


def of_each(
    detectors: Sequence[str],
    models: Sequence[str],
    estimate: Callable[[ModelUnderDetector], Interval],
    note: Callable[[ModelUnderDetector], str] = lambda at: "",
    *,
    low: float = -math.inf,
    high: float = math.inf,
    unit: str = "",
) -> Callable[[Evidence], Iterator[ClaimPart]]:
    """One figure for each model under each detector, named by what differs.

    Args:
        detectors: names.
        models: names.
        estimate: the figure.
        note: further figures in words.
        low: the claim says the figure lies above this.
        high: and below this.
        unit: of the figure.
    """

    def examine(evidence: Evidence) -> Iterator[ClaimPart]:
        for model in models:
            for detector in detectors:
                at = ModelUnderDetector(evidence, model, detector)
                label = f"{model}, {detector}" if len(models) > 1 else detector
                yield ClaimPart(label, estimate(at), low, high, unit, note=note(at))

    return examine


def means_of(figures: Sequence[tuple[BySeed, Figure]], unit: str = "") -> str:
    """Means of figures over runs, in words."""
    means = [over(runs, figure).value for runs, figure in figures]
    return " and ".join(f"{number(m)}{unit}" for m in means if m is not None)


def figure_text(value: float | None, digits: int = 3) -> str:
    """A figure in words."""
    return "unknown" if value is None else number(value, digits)
