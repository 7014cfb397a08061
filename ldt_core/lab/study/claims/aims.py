"""What a learner beyond the paper is to reach, as a list of aims met or missed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from operator import attrgetter

from ldt_core.base.sentences import counted, number
from ldt_core.lab.statistics import mean, proportion, rate
from ldt_core.lab.study.claims.claim import Claim, ClaimPart, ClaimVerdict, Statement, percent
from ldt_core.lab.study.drift_detection import delays, drifts_of
from ldt_core.lab.study.facts import PROMPT_WINDOW
from ldt_core.lab.study.study import BySeed, Evidence, ScoredRun, over

AIM = "an aim of this project"
MODEL, DETECTOR = "diagnosed", "adequacy"  # the learner that the aims are about
OVER_TRUE = 1.5  # times the MME of the true model
LEFT_SHARE = 0.1  # share of the original's MME
RECALL, PRECISION = 0.9, 0.8
PROMPT_SHARE = 0.9  # share of the drifts of twice the detectable size that are to be found at once

Parts = Iterator[ClaimPart | str]


def near_the_true_model(evidence: Evidence) -> Parts:
    """MME over that of the true model, beside the true model one experiment late."""
    runs = _runs(evidence)
    yield _part(runs, "over_floor", high=OVER_TRUE)
    yield from _unprepared(runs, attrgetter("facts.mme_floor"), "times the true model's", OVER_TRUE)


def share_of_the_original(evidence: Evidence) -> Parts:
    """MME over that of the original, beside that of the true model one experiment late."""
    runs = _runs(evidence)
    yield _part(runs, "share", high=LEFT_SHARE)
    yield from _unprepared(
        runs, attrgetter("score.mme_original"), "of the original's MME", LEFT_SHARE
    )


def surplus_of_adaptations(evidence: Evidence) -> Parts:
    """Adaptations beyond one for each drift that can be found."""

    def surplus(run: ScoredRun) -> float | None:
        visible = run.score.detectable
        return None if visible is None else run.score.adaptations - visible

    runs = _runs(evidence)
    own = over(runs, attrgetter("score.adaptations")).value
    drifts = over(runs, attrgetter("score.detectable")).value
    note = "" if drifts is None or own is None else f"{number(own)} for {number(drifts)} drifts"
    yield ClaimPart("", over(runs, surplus), high=0.0, inclusive=True, note=note)


def prompt_detection(evidence: Evidence) -> Parts:
    """Share of the large drifts that are found at once."""
    runs = _runs(evidence)
    hits = {seed: _prompt_hits(run) for seed, run in runs.items()}
    shares = mean(mean(map(float, found)).value for found in hits.values())
    yield ClaimPart("", shares, low=PROMPT_SHARE, inclusive=True)
    every = [h for found in hits.values() for h in found]
    if every:
        yield f"{sum(every)} of {len(every)} drifts in all."


def detectable_recall(evidence: Evidence) -> Parts:
    """Recall over the drifts that can be found."""
    runs = _runs(evidence)
    yield _part(runs, "recall_detectable", low=RECALL)
    known = [r.score for r in runs.values() if r.score.detectable is not None]
    whole = sum(s.detectable or 0 for s in known)
    part = sum(s.detected_detectable or 0 for s in known)
    if whole:
        yield f"In all {part} of {whole} drifts, {percent(proportion(part, whole).value)}."


def precision(evidence: Evidence) -> Parts:
    """Precision by the paper's rule."""
    runs = _runs(evidence)
    yield _part(runs, "precision", low=PRECISION)
    if runs:
        alarms = sum(r.score.false_alarms for r in runs.values())
        positives, many = counted(alarms, "positive"), counted(len(runs), "stream")
        yield f"Outside all windows {positives} in {many}."


def false_alarms_as_stated(evidence: Evidence) -> Claim:
    """The stated false-alarm rate on streams on which nothing drifts.

    What is stated is the most that there may be. Missed when the exact interval of the rate
    observed lies above it, else met: there is no third answer, but few experiments hold little
    against a rate. The evidence says how many.
    """
    statement = Statement(
        "false-alarms-as-stated",
        "On streams without drift false alarms are no more frequent than stated.",
        AIM,
        "False alarms in 1000 experiments without drift",
        lambda evidence: (),
        aim=True,
    )
    results = [
        r for r in evidence.study.results(model=MODEL, detector=DETECTOR) if not drifts_of(r.truth)
    ]
    if not results:
        return statement.examined(evidence)
    stated = 1000 / float(results[0].case.resolved["false_alarm_every"])
    alarms = sum(len(r.positives) for r in results)
    exposure = sum(len(r.number) for r in results)
    found = rate(alarms, exposure / 1000)
    text = (
        f"{statement.measure}: {found.text()}, {alarms} in {exposure} experiments of "
        f"{counted(len(results), 'stream')}; stated {number(stated)}."
    )
    verdict = ClaimVerdict.MET if found.low <= stated else ClaimVerdict.MISSED
    return Claim(statement.id, statement.text, statement.where, verdict, text)


def _runs(evidence: Evidence) -> BySeed:
    return evidence.runs(MODEL, DETECTOR, "better")


def _part(runs: BySeed, figure: str, low: float = -math.inf, high: float = math.inf) -> ClaimPart:
    estimate = over(runs, attrgetter(f"score.{figure}"))
    return ClaimPart("", estimate, low=low, high=high, inclusive=True)


def _unprepared(
    runs: BySeed, whole: Callable[[ScoredRun], float], of: str, aim: float
) -> Iterator[str]:
    """What prediction before learning costs the true model: a reference, no bound."""

    def reference_of(run: ScoredRun) -> float | None:
        if run.facts is None or not whole(run):
            return None
        return run.facts.mme_late / whole(run)

    late = over(runs, reference_of)
    if late.value is None:
        return
    yield (
        "Who predicts before learning meets each drift once unprepared. The reference, the true "
        f"model one experiment late, has {late.text()} {of}."
    )
    if late.low > aim:
        yield "So the reference misses this aim, too: it does not foresee drifts."


def _prompt_hits(run: ScoredRun) -> list[bool]:
    if run.facts is None:
        return []
    after = delays(run.facts.twice, run.result.positives, PROMPT_WINDOW)
    return [drift in after for drift in run.facts.twice]


AIMS: tuple[Statement | Callable[[Evidence], Claim], ...] = (
    Statement(
        "near-the-true-model",
        f"MME at most {OVER_TRUE:g} times that of the true model with the true e.",
        AIM,
        "MME as a multiple of the true model's",
        near_the_true_model,
        aim=True,
    ),
    Statement(
        "a-tenth-of-the-original",
        f"MME below {LEFT_SHARE:.0%} of the original model's.",
        AIM,
        "MME as a share of the original's",
        share_of_the_original,
        aim=True,
    ),
    Statement(
        "no-needless-adaptations",
        "No more adaptations than there are detectable drifts.",
        AIM,
        "Adaptations minus detectable drifts",
        surplus_of_adaptations,
        aim=True,
    ),
    false_alarms_as_stated,
    Statement(
        "prompt-detection",
        f"A drift of twice the detectable size is found within {PROMPT_WINDOW} experiments "
        f"(at least {PROMPT_SHARE:.0%} of them).",
        AIM,
        "Share of those drifts found in time",
        prompt_detection,
        aim=True,
    ),
    Statement(
        "recall-of-the-detectable",
        f"Recall over the detectable drifts at least {RECALL:g}.",
        AIM,
        "Recall",
        detectable_recall,
        aim=True,
    ),
    Statement(
        "precision-of-positives",
        f"Precision at least {PRECISION:g}.",
        AIM,
        "Precision",
        precision,
        aim=True,
    ),
)
