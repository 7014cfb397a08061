"""What the paper says of the detectors on the hybrid model (its figures against e)."""

from __future__ import annotations

import numpy as np

from ldt_core.base.experiment import Level
from ldt_core.base.sentences import number
from ldt_core.lab.study.claims.claim import Claim, Part, Statement
from ldt_core.lab.study.claims.evidence import (
    ACTIVE,
    PAPER_DETECTORS,
    PAPER_MODELS,
    PASSIVE,
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
from ldt_core.lab.study.statistics import mean, proportion, rank_correlation

ERROR_FIGURE = "figure of MME against e"
COUNT_FIGURE = "figure of adaptations against e"
CONCLUSION = "conclusion"
NO_TREND = 0.3  # a rank correlation within this is commonly called none or weak
JUMPS = 0.1  # share of the experiments, those with the largest growth of the error
BEFORE = 5  # experiments whose mean error that growth is against
MOST = 0.5  # "no adaptation while e is small" is true of more than half of the streams


def mme_grows_with_e(evidence: Evidence) -> Claim:
    """Figure of MME against e."""
    statement = Statement(
        "mme-grows-with-e",
        "The error grows with e, whatever the detector.",
        ERROR_FIGURE,
        "Rank correlation of the mean maximum error with e",
    )
    runs = {d: evidence.runs("hybrid", d) for d in PAPER_DETECTORS}
    runs["never"] = evidence.baseline(next(filter(None, runs.values()), {}), "never")
    parts = [Part(d, over(r.values(), _error_trend), low=0.0) for d, r in runs.items()]
    return statement.examined(parts)


def every_detector_beats_never(evidence: Evidence) -> Claim:
    """Figure of MME against e."""
    statement = Statement(
        "every-detector-beats-never",
        "With each detector the hybrid model has a smaller MME than without adaptation.",
        ERROR_FIGURE,
        "MME, adapted / never adapted",
    )
    parts = []
    for detector in PAPER_DETECTORS:
        runs = evidence.runs("hybrid", detector)
        parts.append(Part(detector, shares(runs.values(), left), high=1.0))
    return statement.examined(parts)


def active_beats_window(evidence: Evidence) -> Claim:
    """Figure of MME against e, and the conclusion on passive detectors."""
    statement = Statement(
        "active-beats-window",
        "Threshold detector and LDDM reach a smaller MME than the window detector (hybrid model).",
        f"{ERROR_FIGURE}; {CONCLUSION}",
        "MME, active / window",
    )
    window = evidence.runs("hybrid", PASSIVE)
    spent = over(window.values(), adaptations).value
    parts = []
    for detector in ACTIVE:
        runs = evidence.runs("hybrid", detector)
        own = over(runs.values(), adaptations).value
        note = f"adaptations {_one(own)} against {_one(spent)}"
        parts.append(Part(detector, ratio(runs, window, mme), high=1.0, note=note))
    return statement.examined(parts)


def active_beats_calendar(evidence: Evidence) -> Claim:
    """The conclusion on passive detectors, at equal cost."""
    return _beats(
        evidence,
        "periodic",
        "active-beats-calendar",
        "Active detectors also beat as many adaptations spread evenly over the run.",
    )


def active_beats_chance(evidence: Evidence) -> Claim:
    """The conclusion on passive detectors, at equal cost."""
    return _beats(
        evidence,
        "random",
        "active-beats-chance",
        "Active detectors also beat as many adaptations at random.",
    )


def _beats(evidence: Evidence, name: str, identifier: str, text: str) -> Claim:
    statement = Statement(
        identifier,
        text,
        f"{CONCLUSION}, at equal numbers (our condition)",
        f"MME, active / {name}",
    )
    parts = []
    for model in PAPER_MODELS:
        for detector in ACTIVE:
            runs = evidence.runs(model, detector)
            share = ratio(runs, evidence.baseline(runs, name), mme)
            parts.append(Part(f"{model}, {detector}", share, high=1.0))
    return statement.examined(parts)


def recall_above_chance(evidence: Evidence) -> Claim:
    """What table 1 needs to mean anything."""
    return _above_chance(evidence, "recall", "detect more drifts")


def precision_above_chance(evidence: Evidence) -> Claim:
    """What table 1 needs to mean anything."""
    return _above_chance(evidence, "precision", "reveal a drift more often")


def _above_chance(evidence: Evidence, figure: str, do: str) -> Claim:
    statement = Statement(
        f"{figure}-above-chance",
        f"The positives of the active detectors {do} than as many at random would.",
        "table 1, implied",
        f"{figure.capitalize()} minus its expectation by chance",
    )
    parts = []
    for model in PAPER_MODELS:
        for detector in ACTIVE:
            runs = evidence.runs(model, detector).values()
            own = over(runs, lambda r: getattr(r.score, figure)).value
            by_chance = over(runs, lambda r: getattr(r.score, f"chance_{figure}")).value
            gain = over(runs, lambda r: _minus_chance(r, figure))
            note = f"{_one(own, 2)} against {_one(by_chance, 2)}"
            parts.append(Part(f"{model}, {detector}", gain, low=0.0, note=note))
    return statement.examined(parts)


def quiet_while_e_is_small(evidence: Evidence) -> Claim:
    """Figure of adaptations against e."""
    statement = Statement(
        "quiet-while-e-is-small",
        "While e is small, threshold detector and LDDM trigger no adaptation. Small: before any "
        "experiment of the stream touches the Sommerfeld region.",
        COUNT_FIGURE,
        "Share of streams without an adaptation while e is small",
    )
    parts = []
    for detector in ACTIVE:
        counts = [sum(r.adapted[: _onset(r)]) for r in _touching(evidence, detector)]
        share = proportion(sum(c == 0 for c in counts), len(counts))
        note = f"{_one(mean(counts).value)} adaptations a stream"
        parts.append(Part(detector, share, low=MOST, note=note))
    return statement.examined(parts)


def busy_where_e_is_large(evidence: Evidence) -> Claim:
    """Figure of adaptations against e."""
    statement = Statement(
        "busy-where-e-is-large",
        "Threshold detector and LDDM adapt more often where e is large, from the first experiment "
        "on that touches the Sommerfeld region.",
        COUNT_FIGURE,
        "Adaptations in 100 experiments, e large minus e small",
    )
    parts = []
    for detector in ACTIVE:
        runs = _touching(evidence, detector)
        parts.append(Part(detector, over(runs, _busier), low=0.0))
    return statement.examined(parts)


def active_more_alert(evidence: Evidence) -> Claim:
    """Caption of the figure of adaptations."""
    statement = Statement(
        "active-more-alert",
        "Threshold detector and LDDM answer an abrupt increase in error more often than the window "
        f"detector: are positive in the {JUMPS:.0%} of the experiments whose error grew most "
        f"against the mean of the {BEFORE} before.",
        f"{COUNT_FIGURE}, caption",
        "Share of those experiments with a positive, active minus window",
    )
    window = evidence.runs("hybrid", PASSIVE)
    parts = []
    for detector in ACTIVE:
        runs = evidence.runs("hybrid", detector)
        parts.append(Part(detector, difference(runs, window, _alertness), low=0.0))
    return statement.examined(parts)


def window_follows_residence(evidence: Evidence) -> Claim:
    """Figure of adaptations against e."""
    statement = Statement(
        "window-follows-residence",
        "The adaptations of the window detector at a value of e follow from how long e stays "
        f"there, not from e: adaptations an experiment do not depend on it (within ±{NO_TREND}).",
        COUNT_FIGURE,
        "Rank correlation of adaptations an experiment with e",
    )
    runs = evidence.runs("hybrid", PASSIVE)
    counts = over(runs.values(), lambda r: rank_correlation(*_residence(r))).value
    remark = f"With the length of the stay their number correlates by {_one(counts, 2)}."
    trend = over(runs.values(), _rate_trend)
    return statement.examined(
        [Part(PASSIVE, trend, low=-NO_TREND, high=NO_TREND)], remark if runs else ""
    )


def _touching(evidence: Evidence, detector: str) -> list[Run]:
    """Runs whose stream has both experiments before the Sommerfeld region and from there on."""
    runs = evidence.runs("hybrid", detector).values()
    return [r for r in runs if 0 < _onset(r) < len(r.result.number)]


def _onset(run: Run) -> int:
    """Place of the first experiment that touches the region; behind the last without any."""
    touched = (i for i, v in enumerate(run.result.region_rmse) if v is not None)
    return next(touched, len(run.result.number))


def _busier(run: Run) -> float:
    onset, adapted = _onset(run), run.adapted
    small, large = adapted[:onset], adapted[onset:]
    return 100 * (sum(large) / len(large) - sum(small) / len(small))


def _alertness(run: Run) -> float | None:
    error = np.array(run.result.max_error)
    if error.size < 2 * BEFORE:
        return None
    before = np.convolve(error, np.full(BEFORE, 1 / BEFORE), "valid")[:-1]
    growth = error[BEFORE:] - before
    most = np.argsort(growth, kind="stable")[-max(1, round(JUMPS * growth.size)) :]
    level = np.array(run.result.level)[BEFORE:]
    return float(np.mean(level[most] == Level.POSITIVE))


def _error_trend(run: Run) -> float | None:
    return rank_correlation(*run.by_level(run.result.max_error))


def _rate_trend(run: Run) -> float | None:
    return rank_correlation(*run.by_level(run.adapted))


def _residence(run: Run) -> tuple[list[int], list[int]]:
    """(experiments, adaptations) at each value of what wears."""
    places = run.levels.values()
    return [len(p) for p in places], [sum(run.adapted[i] for i in p) for p in places]


def _minus_chance(run: Run, figure: str) -> float | None:
    own, by_chance = getattr(run.score, figure), getattr(run.score, f"chance_{figure}")
    return None if own is None or by_chance is None else own - by_chance


def _one(value: float | None, digits: int = 3) -> str:
    return "unknown" if value is None else number(value, digits)


CLAIMS = (
    mme_grows_with_e,
    every_detector_beats_never,
    active_beats_window,
    active_beats_calendar,
    active_beats_chance,
    recall_above_chance,
    precision_above_chance,
    quiet_while_e_is_small,
    busy_where_e_is_large,
    active_more_alert,
    window_follows_residence,
)
