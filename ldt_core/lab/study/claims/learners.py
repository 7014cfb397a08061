"""Figures of a model under a detector: what most claims compare."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter

from ldt_core.base.sentences import number
from ldt_core.lab.study.claims.claim import ClaimPart
from ldt_core.lab.study.evidence import BySeed, Evidence, Figure, ScoredRun, over
from ldt_core.lab.study.statistics import Interval

ACTIVE = ("threshold", "lddm")
PASSIVE = "window"
PAPER_DETECTORS = (*ACTIVE, PASSIVE)
PAPER_MODELS = ("linear", "hybrid")


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


def text_of(value: float | None, digits: int = 3) -> str:
    """A figure in words."""
    return "unknown" if value is None else number(value, digits)
