"""What a learner beyond the paper is to reach, as a list of aims met or missed."""

from __future__ import annotations

import math

from ldt_core.base.sentences import number
from ldt_core.lab.study.claims.claim import Claim, Part, Statement, Verdict, percent
from ldt_core.lab.study.claims.evidence import BySeed, Evidence, Run, over
from ldt_core.lab.study.drift_detection import drifts_of
from ldt_core.lab.study.facts import QUICK
from ldt_core.lab.study.scores import delays
from ldt_core.lab.study.statistics import mean, proportion, rate

AIM = "an aim of this project"
MODEL, DETECTOR = "diagnosed", "calibrated"  # the learner that the aims are about
OVER_FLOOR = 1.5  # times the MME of the true model
LEFT = 0.1  # share of the original's MME
RECALL, PRECISION = 0.9, 0.8
PROMPT = 0.9  # share of the drifts of twice the detectable size that are to be found at once


def near_the_floor(evidence: Evidence, model: str, detector: str) -> Claim:
    """MME within 1.5 times the floor."""
    statement = Statement(
        "near-the-floor",
        f"MME at most {OVER_FLOOR:g} times that of the true model with the true e.",
        AIM,
        "MME as a multiple of the floor",
    )
    runs = evidence.runs(model, detector, "better")
    parts = [_part(runs, "over_floor", high=OVER_FLOOR)]
    remark = _unprepared(runs, "mme_floor", "times the floor", OVER_FLOOR)
    return statement.examined(parts, remark, aim=True)


def a_tenth_of_the_original(evidence: Evidence, model: str, detector: str) -> Claim:
    """MME under a tenth of the original's."""
    statement = Statement(
        "a-tenth-of-the-original",
        f"MME below {LEFT:.0%} of the original model's.",
        AIM,
        "MME as a share of the original's",
        {"hybrid": 0.68, "linear": 0.88},
    )
    runs = evidence.runs(model, detector, "better")
    remark = _unprepared(runs, "original", "of the original's MME", LEFT)
    return statement.examined([_part(runs, "share", high=LEFT)], remark, aim=True)


def no_needless_adaptations(evidence: Evidence, model: str, detector: str) -> Claim:
    """At most as many adaptations as there are detectable drifts."""
    statement = Statement(
        "no-needless-adaptations",
        "No more adaptations than there are detectable drifts.",
        AIM,
        "Adaptations minus detectable drifts",
    )
    runs = evidence.runs(model, detector, "better").values()
    own = over(runs, lambda r: r.score.adaptations).value
    drifts = over(runs, lambda r: r.score.detectable).value
    note = "" if drifts is None or own is None else f"{number(own)} for {number(drifts)} drifts"
    parts = [Part("", over(runs, _surplus), high=0.0, inclusive=True, note=note)]
    return statement.examined(parts, aim=True)


def false_alarms_as_stated(evidence: Evidence, model: str, detector: str) -> Claim:
    """The stated false-alarm rate on streams on which nothing drifts.

    Met when the exact interval of the rate observed holds the stated one, missed when not: there is
    no third answer, but few experiments hold little against a rate. The evidence says how many.
    """
    statement = Statement(
        "false-alarms-as-stated",
        "On streams without drift the false-alarm rate is the stated one.",
        AIM,
        "False alarms in 1000 experiments without drift",
    )
    results = [
        r for r in evidence.study.results(model=model, detector=detector) if not drifts_of(r.truth)
    ]
    if not results:
        return statement.examined([], aim=True)
    stated = 1000 / float(results[0].case.resolved["false_alarm_every"])
    alarms = sum(len(r.positives) for r in results)
    exposure = sum(len(r.number) for r in results)
    found = rate(alarms, exposure / 1000)
    text = (
        f"{statement.measure}: {found.text()}, {alarms} in {exposure} experiments of "
        f"{len(results)} streams; stated {number(stated)}."
    )
    met = found.low <= stated <= found.high
    numbers = {"observed": found.as_dict(), "stated": stated, "experiments": exposure}
    verdict = Verdict.MET if met else Verdict.MISSED
    return Claim(statement.id, statement.text, statement.where, verdict, text, numbers)


def prompt_detection(evidence: Evidence, model: str, detector: str) -> Claim:
    """Detection within two experiments."""
    statement = Statement(
        "prompt-detection",
        f"A drift of twice the detectable size is found within {QUICK} experiments "
        f"(at least {PROMPT:.0%} of them).",
        AIM,
        "Share of those drifts found in time",
    )
    runs = evidence.runs(model, detector, "better")
    parts = [Part("", over(runs.values(), _prompt), low=PROMPT, inclusive=True)]
    hits = [h for r in runs.values() for h in _prompt_hits(r)]
    remark = f"{sum(hits)} of {len(hits)} drifts in all." if hits else ""
    return statement.examined(parts, remark, aim=True)


def recall_of_the_detectable(evidence: Evidence, model: str, detector: str) -> Claim:
    """Recall over the drifts that can be found."""
    statement = Statement(
        "recall-of-the-detectable",
        f"Recall over the detectable drifts at least {RECALL:g}.",
        AIM,
        "Recall",
        {"hybrid": 0.33},
    )
    runs = evidence.runs(model, detector, "better")
    part = _part(runs, "recall_detectable", low=RECALL)
    return statement.examined([part], _pooled(runs), aim=True)


def precision_of_positives(evidence: Evidence, model: str, detector: str) -> Claim:
    """Precision by the paper's rule."""
    statement = Statement(
        "precision-of-positives",
        f"Precision at least {PRECISION:g}.",
        AIM,
        "Precision",
        {"hybrid": 0.12},
    )
    runs = evidence.runs(model, detector, "better")
    remark = ""
    if runs:
        alarms = sum(r.score.false_alarms for r in runs.values())
        stale = sum(r.score.stale_alarms for r in runs.values())
        remark = (
            f"Outside all windows {alarms} positives in {len(runs)} streams, {stale} of them while "
            "the machine was not as the model had last seen it."
        )
    return statement.examined([_part(runs, "precision", low=PRECISION)], remark, aim=True)


def _part(runs: BySeed, figure: str, low: float = -math.inf, high: float = math.inf) -> Part:
    estimate = over(runs.values(), lambda r: getattr(r.score, figure))
    return Part("", estimate, low=low, high=high, inclusive=True)


def _unprepared(runs: BySeed, against: str, of: str, aim: float) -> str:
    """What prediction before learning costs: the bound that the true model one late sets."""

    def bound_of(run: Run) -> float | None:
        if run.facts is None:
            return None
        whole = run.score.mme_original if against == "original" else run.facts.mme_floor
        return run.facts.mme_late / whole if whole else None

    bound = over(runs.values(), bound_of)
    if bound.value is None:
        return ""
    remark = (
        "Who predicts before learning meets each drift once unprepared: the true model, one "
        f"experiment late, has {bound.text()} {of}."
    )
    beyond = "So the aim is beyond a learner that does not foresee drifts."
    return f"{remark} {beyond}" if bound.low > aim else remark


def _surplus(run: Run) -> float | None:
    visible = run.score.detectable
    return None if visible is None else run.score.adaptations - visible


def _prompt_hits(run: Run) -> list[bool]:
    if run.facts is None:
        return []
    after = delays(run.facts.twice, run.result.positives, QUICK)
    return [drift in after for drift in run.facts.twice]


def _prompt(run: Run) -> float | None:
    hits = _prompt_hits(run)
    return mean([float(h) for h in hits]).value


def _pooled(runs: BySeed) -> str:
    known = [r.score for r in runs.values() if r.score.detectable is not None]
    whole = sum(s.detectable or 0 for s in known)
    part = sum(s.detected_detectable or 0 for s in known)
    if not whole:
        return ""
    share = proportion(part, whole)
    return f"In all {part} of {whole} drifts, {percent(share.value)}."


AIMS = (
    near_the_floor,
    a_tenth_of_the_original,
    no_needless_adaptations,
    false_alarms_as_stated,
    prompt_detection,
    recall_of_the_detectable,
    precision_of_positives,
)
