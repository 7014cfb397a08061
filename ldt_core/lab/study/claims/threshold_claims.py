"""What the paper says of the influence of the threshold (its figure of four panels)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np

from ldt_core.base.sentences import number
from ldt_core.lab.statistics import geometric_mean, mean, trend
from ldt_core.lab.study.claims.claim import (
    ACTIVE,
    NO_TREND,
    ClaimPart,
    Statement,
    adaptations,
    mme,
)
from ldt_core.lab.study.study import BySeed, Evidence, ScoredRun, ratio
from ldt_core.lab.study.study_plan import PAPER_MODELS

FIGURE = "figure of the threshold"
MUCH_LESS_SHARE = 0.5  # "much smaller": less than half
#: Turns of a curve with one minimum; what fluctuates has more.
ONE_TURN = 1.0

Curves = list[tuple[list[float], list[float]]]


def at_every_threshold(evidence: Evidence) -> Iterator[ClaimPart | str]:
    """Panels a and b, hybrid over linear."""
    idle = []
    for detector in ACTIVE:
        linear, hybrid = (evidence.sweep(m, detector) for m in PAPER_MODELS)
        for value in sorted(linear.keys() & hybrid.keys()):
            label = f"{detector} at {value:g} rad/s"
            runs = [*linear[value].values(), *hybrid[value].values()]
            if any(r.score.adaptations for r in runs):
                yield ClaimPart(label, ratio(hybrid[value], linear[value], mme), high=1.0)
            else:
                idle.append(label)
    if idle:
        yield f"Neither model adapted at {', '.join(idle)}."


def adaptations_over_threshold(evidence: Evidence) -> Iterator[ClaimPart]:
    """Panels c and d."""
    for model, detector in product(PAPER_MODELS, ACTIVE):
        found = trend(_curves(evidence.sweep(model, detector), adaptations))
        yield ClaimPart(f"{model}, {detector}", found, high=0.0)


def linear_mme_over_threshold(evidence: Evidence) -> Iterator[ClaimPart]:
    """Panels a and b, linear model."""
    for detector in ACTIVE:
        curves = _curves(evidence.sweep("linear", detector), mme)
        yield ClaimPart(detector, trend(curves), -NO_TREND, NO_TREND, note=_spread(curves))


def best_between_the_ends(evidence: Evidence) -> Iterator[ClaimPart | str]:
    """Panel a, hybrid model.

    The best threshold between the ends is chosen for each seed by the mean over the others, so that
    it does not win by having been chosen.
    """
    curves = [c for c in _curves(evidence.sweep("hybrid", "threshold"), mme) if len(c[0]) > 2]
    if len({tuple(x) for x, _ in curves}) > 1:  # seeds of an interrupted study
        longest = max((x for x, _ in curves), key=len)
        curves = [c for c in curves if c[0] == longest]
    if len(curves) < 2:
        return
    values, table = curves[0][0], np.log([y for _, y in curves])
    others = (table.sum(axis=0) - table) / (len(table) - 1)
    best = 1 + others[:, 1:-1].argmin(axis=1)
    least = table[np.arange(len(table)), best]
    for end, word in ((0, "smallest"), (-1, "largest")):
        gain = geometric_mean(np.exp(table[:, end] - least).tolist())
        yield ClaimPart(f"{word}, {values[end]:g} rad/s", gain, low=1.0)
    yield f"The least mean MME is at {values[int(table.mean(axis=0).argmin())]:g} rad/s."


def turns_under_lddm(evidence: Evidence) -> Iterator[ClaimPart | str]:
    """Panel b, hybrid model."""
    curves = _curves(evidence.sweep("hybrid", "lddm"), mme)
    yield ClaimPart("lddm", mean(_turns(y) for _, y in curves), low=ONE_TURN, note=_spread(curves))
    other = mean(_turns(y) for _, y in _curves(evidence.sweep("hybrid", "threshold"), mme))
    if other.count:
        yield f"Under the threshold detector {other.text()}."


def share_of_adaptations(evidence: Evidence) -> Iterator[ClaimPart]:
    """Panels c and d, over the thresholds that both detectors have."""
    for model in PAPER_MODELS:
        sweeps = [evidence.sweep(model, d) for d in ACTIVE]
        common = set.intersection(*map(set, sweeps))
        many, few = (_of_each_seed({v: s[v] for v in common}, sum) for s in sweeps)
        shares = [few[s] / many[s] for s in few.keys() & many.keys() if many[s]]
        note = f"{number(float(np.mean(list(few.values()))))} a stream" if few else ""
        yield ClaimPart(model, mean(shares), high=MUCH_LESS_SHARE, note=note)


def range_of_adaptations(evidence: Evidence) -> Iterator[ClaimPart]:
    """Panels c and d: largest minus least number, of seeds that have all thresholds."""
    for model in PAPER_MODELS:
        sweeps = (evidence.sweep(model, d) for d in ACTIVE)
        own, lddm = (
            _of_each_seed(s, lambda row: max(row) - min(row)) if len(s) > 1 else {} for s in sweeps
        )
        gain = mean(own[s] - lddm[s] for s in sorted(own.keys() & lddm.keys()))
        yield ClaimPart(model, gain, low=0.0)


def _turns(row: list[float]) -> int:
    """How often a row changes from rising to falling or back; equal neighbours do not count.

    >>> _turns([3.0, 1.0, 1.0, 2.0]), _turns([1.0, 2.0, 1.0, 2.0])
    (1, 2)
    """
    signs = np.sign(np.diff(row))
    signs = signs[signs != 0]
    return int(np.sum(signs[1:] != signs[:-1]))


def _curves(sweep: dict[float, BySeed], figure: Callable[[ScoredRun], float]) -> Curves:
    """(thresholds, figure at each) of every seed, in order."""
    curves = []
    for seed in sorted({s for runs in sweep.values() for s in runs}):
        known = [v for v, runs in sweep.items() if seed in runs]
        curves.append((known, [figure(sweep[v][seed]) for v in known]))
    return curves


def _spread(curves: Curves) -> str:
    wide = [(max(y) - min(y)) / float(np.mean(y)) for _, y in curves if len(y) > 1]
    return f"range {number(100 * float(np.mean(wide)), 2)} % of the mean" if wide else ""


def _of_each_seed(
    sweep: dict[float, BySeed], of: Callable[[list[float]], float]
) -> dict[int, float]:
    """Seed → a figure of its adaptations over the thresholds, of seeds that have all of these."""
    seeds = set.intersection(*(set(runs) for runs in sweep.values())) if sweep else set()
    return {s: of([adaptations(runs[s]) for runs in sweep.values()]) for s in seeds}


THRESHOLD_CLAIMS = (
    Statement(
        "hybrid-better-at-every-threshold",
        "The hybrid model has a smaller MME than the linear one at every threshold.",
        f"{FIGURE}, panels a and b",
        "MME, hybrid / linear",
        at_every_threshold,
    ),
    Statement(
        "smaller-threshold-adapts-more",
        "With both detectors and both models a smaller threshold leads to more adaptations.",
        f"{FIGURE}, panels c and d",
        "Rank correlation of the adaptations with the threshold",
        adaptations_over_threshold,
    ),
    Statement(
        "linear-mme-ignores-threshold",
        "The linear model's MME does not follow the threshold, since its error is structural "
        f"(rank correlation within ±{NO_TREND}).",
        f"{FIGURE}, panels a and b",
        "Rank correlation of the linear model's MME with the threshold",
        linear_mme_over_threshold,
    ),
    Statement(
        "best-threshold-in-the-middle",
        "The hybrid model under the threshold detector has its least MME in the middle of the "
        "range: too large a threshold is blind, too small a one trains poorly.",
        f"{FIGURE}, panel a",
        "MME, at the end of the range / at the best threshold between",
        best_between_the_ends,
    ),
    Statement(
        "lddm-mme-fluctuates",
        "Under LDDM the hybrid model's MME fluctuates with the threshold: the curve of a stream "
        "turns more than once.",
        f"{FIGURE}, panel b",
        "Turns of the curve of MME over the threshold",
        turns_under_lddm,
    ),
    Statement(
        "lddm-adapts-much-less",
        "At equal thresholds LDDM adapts less than half as often as the threshold detector.",
        f"{FIGURE}, panels c and d",
        "Adaptations under LDDM as a share of those under the threshold detector, over all "
        "thresholds",
        share_of_adaptations,
    ),
    Statement(
        "lddm-adaptations-robust",
        "The number of adaptations depends less on the threshold under LDDM than under the "
        "threshold detector.",
        f"{FIGURE}, panels c and d; conclusion",
        "Range of the adaptations over the thresholds, threshold detector minus LDDM",
        range_of_adaptations,
    ),
)
