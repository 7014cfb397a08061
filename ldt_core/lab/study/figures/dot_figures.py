"""Rows of dots, one for each model and detector: shares, chance, false alarms, kinds of drift."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ldt_core.base.sentences import number
from ldt_core.lab.study.evidence import Evidence
from ldt_core.lab.study.figures.dots import Dots, Panel, dot_plot, key_to_marks
from ldt_core.lab.study.statistics import Interval, mean, rate
from ldt_core.lab.study.study import Study
from ldt_core.lab.study.study_case import RunResult
from ldt_core.lab.study.study_tables import PAPER
from ldt_core.views.page.style import Drawing, Layout, pair

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Figure of `RunScore` → panel.
CHANCE_PANELS = (
    Panel("mme", "MME [rad/s]"),
    Panel("recall", "recall", (0, 1)),
    Panel("precision", "precision", (0, 1)),
    Panel("recall_detectable", "recall of detectable drifts", (0, 1)),
    Panel("delay", "experiments to detection", (1, 5)),
    Panel("false_alarm_rate", "false alarms an experiment", (0, 1)),
)
KINDS_PANELS = (
    Panel("share", "share of the original's MME"),
    Panel("recall", "recall", (0, 1)),
    Panel("precision", "precision", (0, 1)),
)
STATED = "false_alarm_every"  # parameter of a detector that states its rate

Best = tuple[float, str] | None


def shares(evidence: Evidence) -> Drawing | None:
    """MME as a share of the original's; None without runs."""
    rows = [Dots("the paper, on its rotor")]
    for model, printed in PAPER.items():
        exact = {"share": Interval(100 * printed["share"], -np.inf, np.inf, 1)}
        rows.append(Dots(model, model, exact, hollow=True))
    best: Best = None
    for group, heading in (("paper", "here, as in the paper"), ("better", "here, beyond it")):
        pairs = evidence.study.pairs(group)
        rows += [Dots(heading)] if pairs else []
        for (model, detector), results in pairs.items():
            found = evidence.of(results, "share")
            value = None if found.value is None else 100 * found.value
            estimate = Interval(value, 100 * found.low, 100 * found.high, found.count)
            name = pair(model, detector)
            rows.append(Dots(name, model, {"share": estimate}))
            best = _less(best, estimate, f"{name}: {estimate.text('%')}")
    if best is None:
        return None
    floors = _floors(evidence)
    words = "".join(f"; {label}: {value:.1f} %" for label, value in floors)

    def draw(layout: Layout) -> Figure:
        panel = Panel("share", "MME [% of the original model's]", (0, 105), floors)
        figure = dot_plot(layout, rows, [panel], columns=1)
        key_to_marks(figure, layout, hollow="the paper's figure")
        return figure

    return Drawing(
        "shares",
        "What is left of the original model's error",
        f"The least is left by {best[1]}{words}. The paper's hybrid model left 68 %.",
        "Rows of dots: mean maximum error of each learner in per cent of the original model's, "
        "with lines for the floors.",
        draw,
    )


def detectors(evidence: Evidence) -> Drawing | None:
    """All pairs of model and detector beside chance; None without runs of them."""
    rows = []
    for group, heading in (("paper", "as in the paper"), ("better", "beyond the paper")):
        pairs = evidence.study.pairs(group)
        rows += [Dots(heading)] if pairs else []
        for (model, detector), results in pairs.items():
            values = _known(evidence, results, (p.key for p in CHANCE_PANELS))
            beside: dict[str, dict[str, Interval]] = {}
            for key in values:
                for name, found in evidence.beside(results, key).items():
                    if name != "never" or key == "mme":
                        beside.setdefault(name, {})[key] = found
            rows.append(Dots(pair(model, detector), model, values, dict(sorted(beside.items()))))
    shown = [p for p in CHANCE_PANELS if any(p.key in row.values for row in rows)]
    if not shown:
        return None

    def draw(layout: Layout) -> Figure:
        figure = dot_plot(layout, rows, shown, columns=3)
        key_to_marks(figure, layout, baselines=True)
        return figure

    return Drawing(
        "detectors",
        "Each detector beside chance",
        f"{_beside_chance(rows)} Delay and false alarms: a positive within five experiments of a "
        "drift counts for it (1: in its first), any other is a false alarm.",
        "Rows of dots with intervals for every pair of model and detector, beside hollow marks "
        "for never, periodic and random alarms.",
        draw,
    )


def false_alarms(evidence: Evidence) -> Drawing | None:
    """False alarms of each detector on streams without drift; None without such streams."""
    rows, stated, words = [], set(), []
    for (model, detector), every_result in evidence.study.pairs("control").items():
        results = [r for r in every_result if len(set(r.truth)) == 1 and r.case.alarms is None]
        if not results:
            continue
        events = sum(len(r.positives) for r in results)
        exposure = sum(len(r.number) for r in results)
        found = rate(events, exposure)
        rows.append(Dots(pair(model, detector), model, {"rate": found}))
        if detector == "calibrated":
            every = float(results[0].case.resolved[STATED])
            stated.add(1 / every)
            inside = found.low <= 1 / every <= found.high
            words.append(
                f"Stated for the calibrated detector ({model}): one in {every:g}; observed: "
                f"{events} in {exposure} experiments, 95 % interval one in "
                f"{_every(found.high)} to one in {_every(found.low)}, which "
                f"{'holds' if inside else 'does not hold'} what was stated."
            )
    if not rows:
        return None
    lines = [("stated", value) for value in sorted(stated)]
    highest = max([r.values["rate"].high for r in rows] + [value for _, value in lines])

    def draw(layout: Layout) -> Figure:
        panel = Panel("rate", "false alarms an experiment", (0, 1.05 * highest), lines)
        figure = dot_plot(layout, rows, [panel], columns=1)
        key_to_marks(figure, layout, "rate, exact 95 % interval")
        return figure

    caption = " ".join(words) or "None of the detectors here states a rate."
    return Drawing(
        "false_alarms",
        "Stated and observed false alarms, on streams without drift",
        f"{caption} Intervals are exact (Poisson).",
        "Rows of dots: rate of false alarms of each detector with its interval, and a line at "
        "the stated rate.",
        draw,
    )


def kinds(evidence: Evidence) -> Drawing | None:
    """What is left of the error, recall and precision for each kind of drift."""
    rows: list[Dots] = []
    least: list[str] = []
    for label, pairs in _by_kind(evidence.study).items():
        rows.append(Dots(label))
        best: Best = None
        for (model, detector), results in pairs.items():
            values = _known(evidence, results, (p.key for p in KINDS_PANELS))
            rows.append(Dots(pair(model, detector), model, values))
            share = values.get("share")
            if share is not None and share.value is not None:
                best = _less(best, share, f"{label}: {model} {100 * share.value:.0f} %")
        least += [best[1]] if best else []
    if not rows:
        return None

    def draw(layout: Layout) -> Figure:
        figure = dot_plot(layout, rows, KINDS_PANELS, columns=3)
        key_to_marks(figure, layout)
        return figure

    return Drawing(
        "kinds",
        "Other kinds of drift",
        f"Least left of the original's MME, by kind: {'; '.join(least)}. A ramp drifts in every "
        "experiment, so that its recall and precision are those of any alarm.",
        "Rows of dots for each kind of drift and pair of model and detector: share of the "
        "original's error, recall, precision.",
        draw,
    )


def _known(
    evidence: Evidence, results: list[RunResult], figures: Iterable[str]
) -> dict[str, Interval]:
    """The figures that these runs have, with their intervals."""
    values = {name: evidence.of(results, name) for name in figures}
    return {name: v for name, v in values.items() if v.value is not None}


def _less(best: Best, found: Interval, text: str) -> Best:
    """The lesser of two figures, the first of equal ones, with its words."""
    if found.value is None or (best is not None and found.value >= best[0]):
        return best
    return found.value, text


def _floors(evidence: Evidence) -> list[tuple[str, float]]:
    """(label, per cent of the original's MME) of the floors, mean over the streams."""
    true, late = [], []
    for result in {r.case.seed: r for r in evidence.study.results("better")}.values():
        run = evidence.run(result)
        if run.facts is not None:
            true.append(100 * run.facts.mme_floor / run.score.mme_original)
            late.append(100 * run.facts.mme_late / run.score.mme_original)
    found = (("floor: true e", mean(true).value), ("floor: true e, one late", mean(late).value))
    return [(label, value) for label, value in found if value is not None]


def _beside_chance(rows: Iterable[Dots]) -> str:
    better, compared = 0, 0
    for row in rows:
        chance = [row.beside[n] for n in ("periodic", "random") if n in row.beside]
        others = [c["mme"].low for c in chance if "mme" in c]
        if others:
            compared += 1
            better += row.values["mme"].high < min(others)
    if not compared:
        return "No baselines were run, so these figures say nothing of what chance would reach."
    return (
        f"Of {compared} pairs of model and detector, {better} have an MME whose interval lies "
        "below that of periodic and of random alarms with as many adaptations."
    )


def _by_kind(study: Study) -> Mapping[str, dict[tuple[str, str], list[RunResult]]]:
    """The group `kinds`, by what wears how and from which start, by model and detector."""
    found: dict[str, dict[tuple[str, str], list[RunResult]]] = {}
    for result in study.results("kinds"):
        case, resolved = result.case, result.case.resolved
        kind, start = resolved["degradation"] or "staircase", resolved["start"]
        label = f"{kind}, start {start}" if start else kind
        pairs = found.setdefault(label, {})
        pairs.setdefault((case.model, case.detector), []).append(result)
    return found


def _every(per_experiment: float) -> str:
    return number(1 / per_experiment) if per_experiment > 0 else "∞"
