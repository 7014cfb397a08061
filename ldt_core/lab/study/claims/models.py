"""What the paper says of the two models (its table 1 and figure of one experiment)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ldt_core.base.sentences import number
from ldt_core.lab.study.claims.claim import Claim, Part, Statement
from ldt_core.lab.study.claims.evidence import (
    ACTIVE,
    PAPER_DETECTORS,
    PAPER_MODELS,
    BySeed,
    Evidence,
    Run,
    adaptations,
    difference,
    left,
    mme,
    over,
    ratio,
    shares,
)
from ldt_core.lab.study.facts import Drift
from ldt_core.lab.study.scores import delays
from ldt_core.lab.study.statistics import mean

TABLE = "table 1"
LOW_RECALL = 0.5  # "not well performed on recall": fewer than every second drift
SAME_RECALL = 0.1  # recalls that differ by less than one drift in ten are the same
FOLLOWS = 0.5  # a model follows the region when it leaves less than half of the original's error


def hybrid_mme_below_linear(evidence: Evidence) -> Claim:
    """Table 1, first row."""
    statement = Statement(
        "hybrid-mme-below-linear",
        "Under the same detector the hybrid model has a smaller MME than the linear one.",
        TABLE,
        "MME, hybrid / linear",
        {"linear": 8.86, "hybrid": 6.86},
    )
    return statement.examined(_hybrid_over_linear(evidence, mme))


def hybrid_adapts_less(evidence: Evidence) -> Claim:
    """Table 1, number of adaptations."""
    statement = Statement(
        "hybrid-adapts-less",
        "Under the same detector the hybrid model needs fewer adaptations than the linear one.",
        TABLE,
        "Adaptations, linear minus hybrid",
        {"linear": 44, "hybrid": 25},
    )
    parts = []
    for detector in ACTIVE:
        linear, hybrid = (evidence.runs(m, detector) for m in PAPER_MODELS)
        gain = difference(linear, hybrid, adaptations)
        parts.append(Part(detector, gain, low=0.0, note=_means(linear, hybrid, adaptations)))
    return statement.examined(parts)


def linear_below_original(evidence: Evidence) -> Claim:
    """Table 1, MME against that of the original model."""
    return _below_original(evidence, "linear", 8.86)


def hybrid_below_original(evidence: Evidence) -> Claim:
    """Table 1, MME against that of the original model."""
    return _below_original(evidence, "hybrid", 6.86)


def _below_original(evidence: Evidence, model: str, printed: float) -> Claim:
    statement = Statement(
        f"{model}-below-original",
        f"The learning {model} model has a smaller MME than the original model.",
        TABLE,
        "MME, learning / original",
        {model: printed, "original": 10.09},
    )
    parts = []
    for detector in ACTIVE:
        runs = evidence.runs(model, detector)
        means = [over(runs.values(), f).value for f in (mme, lambda r: r.score.mme_original)]
        note = " and ".join(f"{number(m)} rad/s" for m in means if m is not None)
        parts.append(Part(detector, shares(runs.values(), left), high=1.0, note=note))
    return statement.examined(parts)


def hybrid_precision_higher(evidence: Evidence) -> Claim:
    """Table 1, precision."""
    statement = Statement(
        "hybrid-precision-higher",
        "More of the hybrid model's positives reveal a drift than of the linear model's.",
        TABLE,
        "Precision, hybrid minus linear",
        {"linear": 0.06, "hybrid": 0.12},
    )
    parts = []
    for detector in ACTIVE:
        hybrid, linear = (evidence.runs(m, detector) for m in ("hybrid", "linear"))
        gain = difference(hybrid, linear, lambda r: r.score.precision)
        parts.append(Part(detector, gain, low=0.0, note=_both(evidence, detector, "precision")))
    return statement.examined(parts)


def recall_low(evidence: Evidence) -> Claim:
    """Table 1, recall."""
    statement = Statement(
        "recall-low",
        "With both models fewer than half of the drifts are detected.",
        TABLE,
        "Recall",
        {"linear": 0.33, "hybrid": 0.33},
    )
    return statement.examined(
        [
            Part(f"{m}, {d}", over(evidence.runs(m, d).values(), _recall), high=LOW_RECALL)
            for m in PAPER_MODELS
            for d in ACTIVE
        ]
    )


def recall_equal(evidence: Evidence) -> Claim:
    """Table 1, recall."""
    statement = Statement(
        "recall-equal",
        f"Both models detect the same share of drifts (within {SAME_RECALL:g}).",
        TABLE,
        "Recall, hybrid minus linear",
        {"linear": 0.33, "hybrid": 0.33},
    )
    parts = []
    for detector in ACTIVE:
        hybrid, linear = (evidence.runs(m, detector) for m in ("hybrid", "linear"))
        apart = difference(hybrid, linear, _recall)
        parts.append(
            Part(
                detector,
                apart,
                low=-SAME_RECALL,
                high=SAME_RECALL,
                note=_both(evidence, detector, "recall"),
            )
        )
    return statement.examined(parts)


def missed_drifts_are_harmless(evidence: Evidence) -> Claim:
    """The paper's reason for the low recall."""
    statement = Statement(
        "missed-drifts-are-harmless",
        "Drifts are missed because they do not degrade the performance: those missed change the "
        "speed less than those detected.",
        "section on the learning ability",
        "Largest change of the speed by a drift, mean of those detected minus mean of those missed",
    )
    parts, missed, visible = [], 0, 0
    for model in PAPER_MODELS:
        for detector in ACTIVE:
            runs = evidence.runs(model, detector)
            parts.append(
                Part(f"{model}, {detector}", over(runs.values(), _gap), low=0.0, unit="rad/s")
            )
            for run in runs.values():
                lost = _split(run)[1]
                missed, visible = missed + len(lost), visible + sum(d.detectable for d in lost)
    remark = f"Of {missed} drifts missed {visible} would show in the noise." if missed else ""
    return statement.examined(parts, remark)


def linear_misses_the_region(evidence: Evidence) -> Claim:
    """The experiment that the paper shows (no. 92)."""
    statement = Statement(
        "linear-misses-the-region",
        "The linear model does not follow the Sommerfeld effect: in its region it leaves more than "
        f"{FOLLOWS:.0%} of the original's error.",
        "figure of experiment 92",
        "Root mean square error in the region, share of the original's",
    )
    return statement.examined(
        [
            Part(d, shares(evidence.runs("linear", d).values(), region_share), low=FOLLOWS)
            for d in PAPER_DETECTORS
        ]
    )


def hybrid_follows_the_region(evidence: Evidence) -> Claim:
    """The experiment that the paper shows (no. 92)."""
    statement = Statement(
        "hybrid-follows-the-region",
        "The hybrid model follows the Sommerfeld effect: in its region it leaves less than "
        f"{FOLLOWS:.0%} of the original's error.",
        "figure of experiment 92",
        "Root mean square error in the region, share of the original's",
    )
    return statement.examined(
        [
            Part(d, shares(evidence.runs("hybrid", d).values(), region_share), high=FOLLOWS)
            for d in PAPER_DETECTORS
        ]
    )


def hybrid_better_in_the_region(evidence: Evidence) -> Claim:
    """The experiment that the paper shows (no. 92), without a bound of ours."""
    statement = Statement(
        "hybrid-better-in-the-region",
        "In the Sommerfeld region the hybrid model is closer to the machine than the linear one.",
        "figure of experiment 92",
        "Root mean square error in the region, hybrid / linear",
    )
    return statement.examined(_hybrid_over_linear(evidence, region_error))


def region_error(run: Run) -> float | None:
    """Root mean square error in the region, over the experiments that touch it [rad/s]."""
    return _quadratic_mean(run.result.region_rmse)


def region_share(run: Run) -> float | None:
    """The same as a share of the original model's."""
    own, original = (
        _quadratic_mean(r) for r in (run.result.region_rmse, run.result.region_rmse_original)
    )
    return own / original if own is not None and original else None


def _quadratic_mean(row: list[float | None]) -> float | None:
    known = [v for v in row if v is not None]
    return float(np.sqrt(np.mean(np.square(known)))) if known else None


def _recall(run: Run) -> float | None:
    return run.score.recall


def _hybrid_over_linear(evidence: Evidence, error: Callable[[Run], float | None]) -> list[Part]:
    parts = []
    for detector in PAPER_DETECTORS:
        linear, hybrid = (evidence.runs(m, detector) for m in PAPER_MODELS)
        note = _means(hybrid, linear, error, " rad/s")
        parts.append(Part(detector, ratio(hybrid, linear, error), high=1.0, note=note))
    return parts


def _means(
    first: BySeed, second: BySeed, figure: Callable[[Run], float | None], unit: str = ""
) -> str:
    means = [over(runs.values(), figure).value for runs in (first, second)]
    return " and ".join(f"{number(m)}{unit}" for m in means if m is not None)


def _both(evidence: Evidence, detector: str, figure: str) -> str:
    values = {
        m: over(evidence.runs(m, detector).values(), lambda r: getattr(r.score, figure)).value
        for m in PAPER_MODELS
    }
    known = [f"{m} {number(v, 2)}" for m, v in values.items() if v is not None]
    return ", ".join(known)


def _split(run: Run) -> tuple[list[Drift], list[Drift]]:
    """(drifts detected, drifts missed); none without facts."""
    if run.facts is None:
        return [], []
    found = delays([d.number for d in run.facts.drifts], run.result.positives)
    hit = [d for d in run.facts.drifts if d.number in found]
    return hit, [d for d in run.facts.drifts if d.number not in found]


def _gap(run: Run) -> float | None:
    hit, lost = (mean(d.largest for d in part).value for part in _split(run))
    return None if hit is None or lost is None else hit - lost


CLAIMS = (
    hybrid_mme_below_linear,
    hybrid_adapts_less,
    linear_below_original,
    hybrid_below_original,
    hybrid_precision_higher,
    recall_low,
    recall_equal,
    missed_drifts_are_harmless,
    linear_misses_the_region,
    hybrid_follows_the_region,
    hybrid_better_in_the_region,
)
