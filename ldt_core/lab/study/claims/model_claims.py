"""What the paper says of the two models (its table 1 and figure of one experiment)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from operator import attrgetter

import numpy as np

from ldt_core.base.experiment import rms
from ldt_core.base.sentences import number
from ldt_core.lab.statistics import mean
from ldt_core.lab.study.claims.claim import (
    ACTIVE,
    PAPER_DETECTORS,
    ClaimPart,
    Examine,
    ModelUnderDetector,
    Statement,
    adaptations,
    left,
    means_of,
    mme,
    mme_original,
    of_each,
    recall,
)
from ldt_core.lab.study.drift_detection import delays
from ldt_core.lab.study.facts import Drift
from ldt_core.lab.study.study import Evidence, Figure, ScoredRun, difference, over, ratio, shares
from ldt_core.lab.study.study_plan import PAPER_MODELS

TABLE = "table 1"
REGION_FIGURE = "figure of experiment 92"

LOW_RECALL = 0.5  # "not well performed on recall": fewer than every second drift
SAME_RECALL = 0.1  # recalls that differ by less than one drift in ten are the same
FOLLOWED_SHARE = (
    0.5  # a model follows the region when it leaves less than half of the original's error
)


def below_original(model: str) -> Examine:
    """MME of a model over that of the original."""
    return of_each(
        ACTIVE,
        [model],
        lambda at: shares(at.runs, left),
        lambda at: means_of([(at.runs, mme), (at.runs, mme_original)], " rad/s"),
        high=1.0,
    )


def hybrid_over_linear(error: Figure) -> Examine:
    """An error of the hybrid model over that of the linear one."""
    return of_each(
        PAPER_DETECTORS,
        ["hybrid"],
        lambda at: ratio(at.runs, at.beside("linear"), error),
        lambda at: means_of([(at.runs, error), (at.beside("linear"), error)], " rad/s"),
        high=1.0,
    )


def hybrid_minus_linear(name: str, low: float, high: float = math.inf) -> Examine:
    """A score of the hybrid model minus that of the linear one."""
    figure = attrgetter(f"score.{name}")

    def note(at: ModelUnderDetector) -> str:
        values = {m: over(at.beside(m), figure).value for m in PAPER_MODELS}
        return ", ".join(f"{m} {number(v, 2)}" for m, v in values.items() if v is not None)

    return of_each(
        ACTIVE,
        ["hybrid"],
        lambda at: difference(at.runs, at.beside("linear"), figure),
        note,
        low=low,
        high=high,
    )


def in_the_region(model: str, low: float = -math.inf, high: float = math.inf) -> Examine:
    """What a model leaves of the original's error in the Sommerfeld region."""
    return of_each(
        PAPER_DETECTORS, [model], lambda at: shares(at.runs, region_share), low=low, high=high
    )


def missed_drifts(evidence: Evidence) -> Iterator[ClaimPart | str]:
    """How much less the drifts missed change the speed than those detected."""
    gap = of_each(ACTIVE, PAPER_MODELS, lambda at: over(at.runs, _gap), low=0.0, unit="rad/s")
    yield from gap(evidence)
    runs = [r for m in PAPER_MODELS for d in ACTIVE for r in evidence.runs(m, d).values()]
    lost = [drift for run in runs for drift in _split(run)[1]]
    if lost:
        visible = sum(drift.detectable for drift in lost)
        yield f"Of {len(lost)} drifts missed {visible} would show in the noise."


def region_error(run: ScoredRun) -> float | None:
    """Root mean square error in the region, over the experiments that touch it [rad/s]."""
    return _quadratic_mean(run.result.region_rmse)


def region_share(run: ScoredRun) -> float | None:
    """The same as a share of the original model's."""
    own, original = region_error(run), _quadratic_mean(run.result.region_rmse_original)
    return own / original if own is not None and original else None


def _quadratic_mean(row: list[float | None]) -> float | None:
    known = [v for v in row if v is not None]
    return rms(np.array(known)) if known else None


def _split(run: ScoredRun) -> tuple[list[Drift], list[Drift]]:
    """(drifts detected, drifts missed); none without facts."""
    if run.facts is None:
        return [], []
    found = delays([d.number for d in run.facts.drifts], run.result.positives)
    hit = [d for d in run.facts.drifts if d.number in found]
    return hit, [d for d in run.facts.drifts if d.number not in found]


def _gap(run: ScoredRun) -> float | None:
    hit, lost = (mean(d.largest for d in part).value for part in _split(run))
    return None if hit is None or lost is None else hit - lost


MODEL_CLAIMS = (
    Statement(
        "hybrid-mme-below-linear",
        "Under the same detector the hybrid model has a smaller MME than the linear one.",
        TABLE,
        "MME, hybrid / linear",
        hybrid_over_linear(mme),
    ),
    Statement(
        "hybrid-adapts-less",
        "Under the same detector the hybrid model needs fewer adaptations than the linear one.",
        TABLE,
        "Adaptations, linear minus hybrid",
        of_each(
            ACTIVE,
            ["linear"],
            lambda at: difference(at.runs, at.beside("hybrid"), adaptations),
            lambda at: means_of([(at.runs, adaptations), (at.beside("hybrid"), adaptations)]),
            low=0.0,
        ),
    ),
    *(
        Statement(
            f"{model}-below-original",
            f"The learning {model} model has a smaller MME than the original model.",
            TABLE,
            "MME, learning / original",
            below_original(model),
        )
        for model in PAPER_MODELS
    ),
    Statement(
        "hybrid-precision-higher",
        "More of the hybrid model's positives reveal a drift than of the linear model's.",
        TABLE,
        "Precision, hybrid minus linear",
        hybrid_minus_linear("precision", low=0.0),
    ),
    Statement(
        "recall-low",
        "With both models fewer than half of the drifts are detected.",
        TABLE,
        "Recall",
        of_each(ACTIVE, PAPER_MODELS, lambda at: over(at.runs, recall), high=LOW_RECALL),
    ),
    Statement(
        "recall-equal",
        f"Both models detect the same share of drifts (within {SAME_RECALL:g}).",
        TABLE,
        "Recall, hybrid minus linear",
        hybrid_minus_linear("recall", low=-SAME_RECALL, high=SAME_RECALL),
    ),
    Statement(
        "missed-drifts-are-harmless",
        "Drifts are missed because they do not degrade the performance: those missed change the "
        "speed less than those detected.",
        "section on the learning ability",
        "Largest change of the speed by a drift, mean of those detected minus mean of those missed",
        missed_drifts,
    ),
    Statement(
        "linear-misses-the-region",
        "The linear model does not follow the Sommerfeld effect: in its region it leaves more than "
        f"{FOLLOWED_SHARE:.0%} of the original's error.",
        REGION_FIGURE,
        "Root mean square error in the region, share of the original's",
        in_the_region("linear", low=FOLLOWED_SHARE),
    ),
    Statement(
        "hybrid-follows-the-region",
        "The hybrid model follows the Sommerfeld effect: in its region it leaves less than "
        f"{FOLLOWED_SHARE:.0%} of the original's error.",
        REGION_FIGURE,
        "Root mean square error in the region, share of the original's",
        in_the_region("hybrid", high=FOLLOWED_SHARE),
    ),
    Statement(
        "hybrid-better-in-the-region",
        "In the Sommerfeld region the hybrid model is closer to the machine than the linear one.",
        REGION_FIGURE,
        "Root mean square error in the region, hybrid / linear",
        hybrid_over_linear(region_error),
    ),
)
