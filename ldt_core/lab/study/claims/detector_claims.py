"""What the paper says of the detectors on the hybrid model (its figures against e)."""

from __future__ import annotations

from collections.abc import Iterator
from operator import attrgetter

import numpy as np

from ldt_core.base.experiment import Level
from ldt_core.lab.statistics import mean, proportion, rank_correlation
from ldt_core.lab.study.claims.claim import (
    ACTIVE,
    NO_TREND,
    PAPER_DETECTORS,
    PASSIVE,
    ClaimPart,
    Examine,
    ModelUnderDetector,
    Statement,
    adaptations,
    figure_text,
    left,
    mme,
    of_each,
)
from ldt_core.lab.study.study import Evidence, ScoredRun, difference, over, ratio, shares
from ldt_core.lab.study.study_plan import PAPER_MODELS

ERROR_FIGURE = "figure of MME against e"
COUNT_FIGURE = "figure of adaptations against e"
CONCLUSION = "conclusion"
EQUAL_COST = f"{CONCLUSION}, at equal numbers (our condition)"

JUMP_SHARE = 0.1  # share of the experiments, those with the largest growth of the error
JUMP_BASE = 5  # experiments whose mean error that growth is against
QUIET_SHARE = 0.5  # "no adaptation while e is small" is true of more than half of the streams


def above_chance(figure: str) -> Examine:
    """A score of the active detectors minus what as many alarms at random would have."""

    def gain(run: ScoredRun) -> float | None:
        own, by_chance = getattr(run.score, figure), getattr(run.score, f"chance_{figure}")
        return None if own is None or by_chance is None else own - by_chance

    def note(at: ModelUnderDetector) -> str:
        figures = (attrgetter(f"score.{name}") for name in (figure, f"chance_{figure}"))
        own, by_chance = (over(at.runs, f).value for f in figures)
        return f"{figure_text(own, 2)} against {figure_text(by_chance, 2)}"

    return of_each(ACTIVE, PAPER_MODELS, lambda at: over(at.runs, gain), note, low=0.0)


def beats_baseline(name: str) -> Examine:
    """MME of the active detectors over that of as many alarms by another rule."""
    return of_each(
        ACTIVE,
        PAPER_MODELS,
        lambda at: ratio(at.runs, at.evidence.baseline(at.runs, name), mme),
        high=1.0,
    )


def error_trend(evidence: Evidence) -> Iterator[ClaimPart]:
    """How the error grows with what wears, under each detector and without any."""
    runs = {d: evidence.runs("hybrid", d) for d in PAPER_DETECTORS}
    runs["never"] = evidence.baseline(next(filter(None, runs.values()), {}), "never")
    for name, found in runs.items():
        trend = over(found, lambda r: rank_correlation(*r.by_level(r.result.max_error)))
        yield ClaimPart(name, trend, low=0.0)


def quiet_at_first(evidence: Evidence) -> Iterator[ClaimPart]:
    """Share of streams without an adaptation before the region is touched."""
    for detector in ACTIVE:
        counts = [sum(r.adapted[: _onset(r)]) for r in _touching(evidence, detector)]
        share = proportion(sum(c == 0 for c in counts), len(counts))
        note = f"{figure_text(mean(counts).value)} adaptations a stream"
        yield ClaimPart(detector, share, low=QUIET_SHARE, note=note)


def residence(evidence: Evidence) -> Iterator[ClaimPart | str]:
    """Whether adaptations by the calendar depend on e, or on how long it stays."""

    def by_stay(run: ScoredRun) -> float | None:
        places = run.levels.values()
        return rank_correlation(
            [len(p) for p in places], [sum(run.adapted[i] for i in p) for p in places]
        )

    runs = evidence.runs("hybrid", PASSIVE)
    trend = over(runs, lambda r: rank_correlation(*r.by_level(r.adapted)))
    yield ClaimPart(PASSIVE, trend, low=-NO_TREND, high=NO_TREND)
    if runs:
        counts = over(runs, by_stay).value
        if counts is not None:
            by = figure_text(counts, 2)
            yield f"With the length of the stay their number correlates by {by}."


def _touching(evidence: Evidence, detector: str) -> list[ScoredRun]:
    """Runs whose stream has both experiments before the Sommerfeld region and from there on."""
    runs = evidence.runs("hybrid", detector).values()
    return [r for r in runs if 0 < _onset(r) < len(r.result.number)]


def _onset(run: ScoredRun) -> int:
    """Place of the first experiment that touches the region; behind the last without any."""
    touched = (i for i, v in enumerate(run.result.region_rmse) if v is not None)
    return next(touched, len(run.result.number))


def _busier(run: ScoredRun) -> float:
    onset, adapted = _onset(run), run.adapted
    small, large = adapted[:onset], adapted[onset:]
    return 100 * (sum(large) / len(large) - sum(small) / len(small))


def _alertness(run: ScoredRun) -> float | None:
    error = np.array(run.result.max_error)
    if error.size < 2 * JUMP_BASE:
        return None
    before = np.convolve(error, np.full(JUMP_BASE, 1 / JUMP_BASE), "valid")[:-1]
    growth = error[JUMP_BASE:] - before
    most = np.argsort(growth, kind="stable")[-max(1, round(JUMP_SHARE * growth.size)) :]
    level = np.array(run.result.level)[JUMP_BASE:]
    return float(np.mean(level[most] == Level.POSITIVE))


def _spent(at: ModelUnderDetector) -> str:
    own, window = (over(runs, adaptations).value for runs in (at.runs, at.beside("", PASSIVE)))
    return f"adaptations {figure_text(own)} against {figure_text(window)}"


DETECTOR_CLAIMS = (
    Statement(
        "mme-grows-with-e",
        "The error grows with e, whatever the detector.",
        ERROR_FIGURE,
        "Rank correlation of the mean maximum error with e",
        error_trend,
    ),
    Statement(
        "every-detector-beats-never",
        "With each detector the hybrid model has a smaller MME than without adaptation.",
        ERROR_FIGURE,
        "MME, adapted / never adapted",
        of_each(PAPER_DETECTORS, ["hybrid"], lambda at: shares(at.runs, left), high=1.0),
    ),
    Statement(
        "active-beats-window",
        "Threshold detector and LDDM reach a smaller MME than the window detector (hybrid model).",
        f"{ERROR_FIGURE}; {CONCLUSION}",
        "MME, active / window",
        of_each(
            ACTIVE,
            ["hybrid"],
            lambda at: ratio(at.runs, at.beside(detector=PASSIVE), mme),
            _spent,
            high=1.0,
        ),
    ),
    Statement(
        "active-beats-calendar",
        "Active detectors also beat as many adaptations spread evenly over the run.",
        EQUAL_COST,
        "MME, active / periodic",
        beats_baseline("periodic"),
    ),
    Statement(
        "active-beats-chance",
        "Active detectors also beat as many adaptations at random.",
        EQUAL_COST,
        "MME, active / random",
        beats_baseline("random"),
    ),
    *(
        Statement(
            f"{figure}-above-chance",
            f"The positives of the active detectors {do} than as many at random would.",
            "table 1, implied",
            f"{figure.capitalize()} minus its expectation by chance",
            above_chance(figure),
        )
        for figure, do in (
            ("recall", "detect more drifts"),
            ("precision", "reveal a drift more often"),
        )
    ),
    Statement(
        "quiet-while-e-is-small",
        "While e is small, threshold detector and LDDM trigger no adaptation. Small: before any "
        "experiment of the stream touches the Sommerfeld region.",
        COUNT_FIGURE,
        "Share of streams without an adaptation while e is small",
        quiet_at_first,
    ),
    Statement(
        "busy-where-e-is-large",
        "Threshold detector and LDDM adapt more often where e is large, from the first experiment "
        "on that touches the Sommerfeld region.",
        COUNT_FIGURE,
        "Adaptations in 100 experiments, e large minus e small",
        of_each(
            ACTIVE,
            ["hybrid"],
            lambda at: over(_touching(at.evidence, at.detector), _busier),
            low=0.0,
        ),
    ),
    Statement(
        "active-more-alert",
        "Threshold detector and LDDM answer an abrupt increase in error more often than the window "
        f"detector: are positive in the {JUMP_SHARE:.0%} of the experiments whose error grew most "
        f"against the mean of the {JUMP_BASE} before.",
        f"{COUNT_FIGURE}, caption",
        "Share of those experiments with a positive, active minus window",
        of_each(
            ACTIVE,
            ["hybrid"],
            lambda at: difference(at.runs, at.beside(detector=PASSIVE), _alertness),
            low=0.0,
        ),
    ),
    Statement(
        "window-follows-residence",
        "The adaptations of the window detector at a value of e follow from how long e stays "
        f"there, not from e: adaptations an experiment do not depend on it (within ±{NO_TREND}).",
        COUNT_FIGURE,
        "Rank correlation of adaptations an experiment with e",
        residence,
    ),
)
