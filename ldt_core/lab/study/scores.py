"""The figures of one run: the paper's, and those that tell whether they mean anything."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ldt_core.lab.study.drift_detection import DETECTION_WINDOW, delays, detection, drifts_of
from ldt_core.lab.study.facts import Facts
from ldt_core.lab.study.study_case import RunResult


@dataclass(frozen=True)
class RunScore:
    """The figures of one run; None where a figure is undefined (no drifts, no positives).

    Attributes:
        model: that learned.
        detector: or the name of the baseline.
        seed: of the stream.
        experiments: in the run.
        mme: mean maximum error of the learning twin [rad/s].
        mme_original: of the original model [rad/s].
        share: mme / mme_original, what is left of the original's error.
        adaptations: new models that came into force.
        positives: positive signals.
        refusals: positives after which the old model stayed.
        recall: share of drifts with a positive within their five experiments (paper).
        precision: share of positives that reveal a drift (paper).
        chance_recall: expected recall of as many alarms at random.
        chance_precision: expected precision of as many alarms at random.
        drifts: number of drifts.
        detected: drifts with a positive in their window.
        delay: mean over the drifts detected of the experiments from the drift to the first
            positive, 1 being the drift's own; the others (drifts - detected) are known only to have
            taken longer than their window.
        detectable: drifts that can be found at all, None without facts.
        detected_detectable: those of them that were.
        recall_detectable: their share.
        false_alarms: positives in no drift's window.
        outside: experiments in no drift's window.
        false_alarm_rate: false_alarms / outside.
        over_floor: mme / MME of the true model.
        over_late: mme / MME of the true model one experiment late.
    """

    model: str
    detector: str
    seed: int
    experiments: int
    mme: float
    mme_original: float
    share: float | None
    adaptations: int
    positives: int
    refusals: int
    recall: float | None
    precision: float | None
    chance_recall: float | None
    chance_precision: float | None
    drifts: int
    detected: int
    delay: float | None
    detectable: int | None
    detected_detectable: int | None
    recall_detectable: float | None
    false_alarms: int
    outside: int
    false_alarm_rate: float | None
    over_floor: float | None
    over_late: float | None

    def as_dict(self) -> dict[str, Any]:
        """All figures by name."""
        return asdict(self)


def scores_of(result: RunResult, facts: Facts | None = None) -> RunScore:
    """The figures of a run.

    Args:
        result: of the run, experiments numbered without a gap.
        facts: of its stream; None leaves out what needs them.
    """
    drifts, positives = drifts_of(result.truth, result.number[0]), result.positives
    found = detection(drifts, positives)
    after = delays(drifts, positives)
    covered = in_windows(drifts, result.number)
    outside = [p for p in positives if p not in covered]
    expected = chance(drifts, len(positives), result.number)
    mme, original = float(np.mean(result.max_error)), float(np.mean(result.original))
    visible = found_visible = None
    if facts is not None:
        visible = len(facts.detectable)
        found_visible = detection(facts.detectable, positives).detected
    quiet = len(result.number) - len(covered)
    return RunScore(
        model=result.case.model,
        detector=result.case.detector,
        seed=result.case.seed,
        experiments=len(result.number),
        mme=mme,
        mme_original=original,
        share=_ratio(mme, original),
        adaptations=len(result.adaptations),
        positives=len(positives),
        refusals=result.action.count("refused"),
        recall=found.recall,
        precision=found.precision,
        chance_recall=expected[0],
        chance_precision=expected[1],
        drifts=found.drifts,
        detected=found.detected,
        delay=float(np.mean(list(after.values()))) if after else None,
        detectable=visible,
        detected_detectable=found_visible,
        recall_detectable=_ratio(found_visible, visible),
        false_alarms=len(outside),
        outside=quiet,
        false_alarm_rate=_ratio(len(outside), quiet),
        over_floor=_ratio(mme, facts.mme_floor) if facts else None,
        over_late=_ratio(mme, facts.mme_late) if facts else None,
    )


def in_windows(drifts: Iterable[int], numbers: Iterable[int]) -> set[int]:
    """Those of the experiments that lie in some drift's window.

    >>> sorted(in_windows([3, 9], range(1, 11)))
    [3, 4, 5, 6, 7, 9, 10]
    """
    return {n for d in drifts for n in range(d, d + DETECTION_WINDOW)}.intersection(numbers)


def chance(
    drifts: Sequence[int], alarms: int, numbers: Sequence[int]
) -> tuple[float | None, float | None]:
    """Expected (recall, precision) of so many alarms in experiments drawn at random.

    Exact, for all draws without replacement being equally likely. A drift with w experiments in its
    window is missed when all alarms fall outside it. An alarm reveals a drift (`detection`)
    when no other lies between it and the latest drift at most a window before it: it has to keep
    out of so many experiments.

    >>> chance([3], alarms=1, numbers=range(1, 11))
    (0.5, 0.5)
    """
    true, count = sorted(set(drifts)), len(numbers)
    recall = precision = None
    if true:
        sizes = [len(in_windows([d], numbers)) for d in true]
        recall = float(np.mean([1 - _all_outside(w, alarms, count) for w in sizes]))
    if alarms:
        gaps = [n - max(d for d in true if d <= n) for n in in_windows(true, numbers)]
        precision = math.fsum(_all_outside(g, alarms - 1, count - 1) for g in gaps) / count
    return recall, precision


def _all_outside(size: int, alarms: int, count: int) -> float:
    """Probability that none of the alarms drawn from `count` falls into a set of `size`."""
    return math.comb(count - size, alarms) / math.comb(count, alarms)


def _ratio(part: float | None, whole: float | None) -> float | None:
    return part / whole if part is not None and whole else None
