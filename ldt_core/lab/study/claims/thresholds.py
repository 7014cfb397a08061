"""What the paper says of the influence of the threshold (its figure of four panels)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ldt_core.base.sentences import number
from ldt_core.lab.study.claims.claim import Claim, Part, Statement
from ldt_core.lab.study.claims.evidence import (
    ACTIVE,
    PAPER_MODELS,
    BySeed,
    Evidence,
    Run,
    adaptations,
    mme,
    ratio,
)
from ldt_core.lab.study.statistics import geometric_mean, mean, trend

FIGURE = "figure of the threshold"
NO_TREND = 0.3  # a rank correlation within this is commonly called none or weak
MUCH = 0.5  # "much smaller": less than half
#: Turns of a curve with one minimum; what fluctuates has more.
ONE_TURN = 1.0

Curve = tuple[list[float], list[float]]


def hybrid_better_at_every_threshold(evidence: Evidence) -> Claim:
    """Panels a and b."""
    statement = Statement(
        "hybrid-better-at-every-threshold",
        "The hybrid model has a smaller MME than the linear one at every threshold.",
        f"{FIGURE}, panels a and b",
        "MME, hybrid / linear",
    )
    parts, idle = [], []
    for detector in ACTIVE:
        linear, hybrid = (evidence.sweep(m, detector) for m in PAPER_MODELS)
        for value in sorted(linear.keys() & hybrid.keys()):
            label = f"{detector} at {value:g} rad/s"
            if not any(_adapted(sweep[value]) for sweep in (linear, hybrid)):
                idle.append(label)
                continue
            parts.append(Part(label, ratio(hybrid[value], linear[value], mme), high=1.0))
    remark = f"Neither model adapted at {', '.join(idle)}." if idle else ""
    return statement.examined(parts, remark)


def smaller_threshold_adapts_more(evidence: Evidence) -> Claim:
    """Panels c and d."""
    statement = Statement(
        "smaller-threshold-adapts-more",
        "With both detectors and both models a smaller threshold leads to more adaptations.",
        f"{FIGURE}, panels c and d",
        "Rank correlation of the adaptations with the threshold",
    )
    return statement.examined(
        [
            Part(f"{m}, {d}", trend(_curves(evidence.sweep(m, d), adaptations)), high=0.0)
            for m in PAPER_MODELS
            for d in ACTIVE
        ]
    )


def linear_mme_ignores_threshold(evidence: Evidence) -> Claim:
    """Panels a and b."""
    statement = Statement(
        "linear-mme-ignores-threshold",
        "The linear model's MME does not follow the threshold, since its error is structural "
        f"(rank correlation within ±{NO_TREND}).",
        f"{FIGURE}, panels a and b",
        "Rank correlation of the linear model's MME with the threshold",
    )
    parts = []
    for detector in ACTIVE:
        curves = _curves(evidence.sweep("linear", detector), mme)
        note = _spread(curves)
        parts.append(Part(detector, trend(curves), low=-NO_TREND, high=NO_TREND, note=note))
    return statement.examined(parts)


def best_threshold_in_the_middle(evidence: Evidence) -> Claim:
    """Panel a, hybrid model.

    The best threshold between the ends is chosen for each seed by the mean over the others, so that
    it does not win by having been chosen.
    """
    statement = Statement(
        "best-threshold-in-the-middle",
        "The hybrid model under the threshold detector has its least MME in the middle of the "
        "range: too large a threshold is blind, too small a one trains poorly.",
        f"{FIGURE}, panel a",
        "MME, at the end of the range / at the best threshold between",
    )
    curves = [c for c in _curves(evidence.sweep("hybrid", "threshold"), mme) if len(c[0]) > 2]
    if len({tuple(x) for x, _ in curves}) > 1:  # seeds of an interrupted study
        longest = max((x for x, _ in curves), key=len)
        curves = [c for c in curves if c[0] == longest]
    if len(curves) < 2:
        return statement.examined([])
    values, table = curves[0][0], np.log([y for _, y in curves])
    others = (table.sum(axis=0) - table) / (len(table) - 1)
    best = 1 + others[:, 1:-1].argmin(axis=1)
    least = table[np.arange(len(table)), best]
    parts = []
    for end, word in ((0, "smallest"), (-1, "largest")):
        gain = geometric_mean(np.exp(table[:, end] - least).tolist())
        label = f"{word}, {values[end]:g} rad/s"
        parts.append(Part(label, gain, low=1.0))
    overall = values[int(table.mean(axis=0).argmin())]
    return statement.examined(parts, f"The least mean MME is at {overall:g} rad/s.")


def lddm_mme_fluctuates(evidence: Evidence) -> Claim:
    """Panel b, hybrid model."""
    statement = Statement(
        "lddm-mme-fluctuates",
        "Under LDDM the hybrid model's MME fluctuates with the threshold: the curve of a stream "
        "turns more than once.",
        f"{FIGURE}, panel b",
        "Turns of the curve of MME over the threshold",
    )
    curves = _curves(evidence.sweep("hybrid", "lddm"), mme)
    part = Part("lddm", mean(turns(y) for _, y in curves), low=ONE_TURN, note=_spread(curves))
    other = mean(turns(y) for _, y in _curves(evidence.sweep("hybrid", "threshold"), mme))
    remark = f"Under the threshold detector {other.text()}." if other.count else ""
    return statement.examined([part], remark)


def lddm_adapts_much_less(evidence: Evidence) -> Claim:
    """Panels c and d."""
    statement = Statement(
        "lddm-adapts-much-less",
        "At equal thresholds LDDM adapts less than half as often as the threshold detector.",
        f"{FIGURE}, panels c and d",
        "Adaptations under LDDM as a share of those under the threshold detector, over all "
        "thresholds",
    )
    parts = []
    for model in PAPER_MODELS:
        few, many = (_totals(evidence, model, d) for d in ("lddm", "threshold"))
        shares = [few[s] / many[s] for s in few.keys() & many.keys() if many[s]]
        note = f"{number(float(np.mean(list(few.values()))))} a stream" if few else ""
        parts.append(Part(model, mean(shares), high=MUCH, note=note))
    return statement.examined(parts)


def lddm_adaptations_robust(evidence: Evidence) -> Claim:
    """Conclusion: LDDM is more robust considering the number of adaptations."""
    statement = Statement(
        "lddm-adaptations-robust",
        "The number of adaptations depends less on the threshold under LDDM than under the "
        "threshold detector.",
        f"{FIGURE}, panels c and d; conclusion",
        "Range of the adaptations over the thresholds, threshold detector minus LDDM",
    )
    parts = []
    for model in PAPER_MODELS:
        ranges = [_ranges(evidence.sweep(model, d)) for d in ("threshold", "lddm")]
        seeds = ranges[0].keys() & ranges[1].keys()
        gain = mean(ranges[0][s] - ranges[1][s] for s in sorted(seeds))
        parts.append(Part(model, gain, low=0.0))
    return statement.examined(parts)


def turns(row: list[float]) -> int:
    """How often a row changes from rising to falling or back; equal neighbours do not count.

    >>> turns([3.0, 1.0, 1.0, 2.0]), turns([1.0, 2.0, 1.0, 2.0])
    (1, 2)
    """
    signs = np.sign(np.diff(row))
    signs = signs[signs != 0]
    return int(np.sum(signs[1:] != signs[:-1]))


def _curves(sweep: dict[float, BySeed], figure: Callable[[Run], float]) -> list[Curve]:
    """(thresholds, figure at each) of every seed, in order."""
    seeds = sorted({s for runs in sweep.values() for s in runs})
    curves = []
    for seed in seeds:
        known = [v for v, runs in sweep.items() if seed in runs]
        curves.append((known, [figure(sweep[v][seed]) for v in known]))
    return curves


def _adapted(runs: BySeed) -> bool:
    return any(r.score.adaptations for r in runs.values())


def _spread(curves: list[Curve]) -> str:
    wide = [(max(y) - min(y)) / float(np.mean(y)) for _, y in curves if len(y) > 1]
    return f"range {number(100 * float(np.mean(wide)), 2)} % of the mean" if wide else ""


def _totals(evidence: Evidence, model: str, detector: str) -> dict[int, float]:
    """Seed → adaptations over the thresholds that both detectors have."""
    own = evidence.sweep(model, detector)
    common = set.intersection(*(set(evidence.sweep(model, d)) for d in ACTIVE))
    totals: dict[int, float] = {}
    for seed in set.intersection(*(set(own[v]) for v in common)) if common else ():
        totals[seed] = sum(adaptations(own[v][seed]) for v in common)
    return totals


def _ranges(sweep: dict[float, BySeed]) -> dict[int, float]:
    """Seed → largest minus least number of adaptations, of seeds that have all thresholds."""
    if len(sweep) < 2:
        return {}
    complete = set.intersection(*(set(runs) for runs in sweep.values()))
    counts = {s: [adaptations(runs[s]) for runs in sweep.values()] for s in complete}
    return {s: max(c) - min(c) for s, c in counts.items()}


CLAIMS = (
    hybrid_better_at_every_threshold,
    smaller_threshold_adapts_more,
    linear_mme_ignores_threshold,
    best_threshold_in_the_middle,
    lddm_mme_fluctuates,
    lddm_adapts_much_less,
    lddm_adaptations_robust,
)
