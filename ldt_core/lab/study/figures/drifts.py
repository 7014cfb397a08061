"""Which drifts can be found, which were, how often the alarm was false, and kinds of drift."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ldt_core.base.sentences import number
from ldt_core.lab.study.case import Result
from ldt_core.lab.study.drift_detection import detection
from ldt_core.lab.study.facts import Drift, energy_needed, energy_needed_knowing_the_shape
from ldt_core.lab.study.figures.dots import DASHES, Dots, Panel, dot_plot, key_to_marks
from ldt_core.lab.study.figures.reading import Reading
from ldt_core.lab.study.figures.series import wear
from ldt_core.lab.study.statistics import rate
from ldt_core.lab.study.study import Study
from ldt_core.views.page.style import (
    GREEN,
    INK,
    VERMILION,
    Drawing,
    Layout,
    legend,
    pair,
    panels,
    power,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Samples an experiment has when the study kept none to count.
SAMPLES = 2000
LEAST_ENERGY = 1e-2  # shown; a drift that does less to the speed lies on the edge
STATED = "false_alarm_every"  # parameter of a detector that states its rate


def detectable(reading: Reading) -> Drawing | None:
    """Energy of each drift against what wears; None without facts or runs beyond the paper."""
    best = reading.best()
    if best is None:
        return None
    results = reading.study.results("better", model=best[0], detector=best[1])
    points: list[tuple[Drift, bool]] = []
    for result in results:
        facts = reading.study.facts_of(result)
        for drift in facts.drifts if facts else ():
            points.append((drift, bool(detection([drift.number], result.positives).detected)))
    if not points:
        return None
    quantity = wear(results[0])
    samples = _samples(results)
    needed, ideal = energy_needed(samples), energy_needed_knowing_the_shape()
    visible = [found for drift, found in points if drift.detectable]
    hidden = [found for drift, found in points if not drift.detectable]

    def draw(layout: Layout) -> Figure:
        figure, (axes,) = panels(layout, 3.6)
        for found, label, color, marker in (
            (True, f"detected ({sum(f for _, f in points)})", GREEN, "o"),
            (False, f"missed ({sum(not f for _, f in points)})", VERMILION, "x"),
        ):
            chosen = [d for d, f in points if f is found]
            x = quantity.scaled([d.after for d in chosen])
            y = [min(max(d.energy, LEAST_ENERGY), 1e12) for d in chosen]
            axes.plot(x, y, marker, color=color, mfc="none", label=label, mew=1.3)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(power)
        for value, label, dashes in (
            (needed, "detectable from here on", DASHES[1]),
            (ideal, "by its known shape", DASHES[0]),
        ):
            axes.axhline(value, color=INK, lw=1.2, ls=dashes, zorder=1, label=label)
        axes.set_xlabel(quantity.label)
        axes.set_ylabel("energy of the drift |Δy|² / σ²")
        legend(figure, [axes], layout, 4)
        return figure

    return Drawing(
        "detectable",
        "Which drifts can be found, and which were",
        f"{pair(*best)} detector: {sum(visible)} of {len(visible)} "
        f"detectable drifts detected, and {sum(hidden)} of the {len(hidden)} that one experiment "
        "of a drift does not show above the noise (by chance, or over several experiments). "
        f"Each drift stands at the value of {quantity.symbol} that it leads to.",
        "Energy of each drift on a logarithmic scale against the eccentricity after it, marked by "
        "whether it was detected, with the limit above which it is detectable.",
        draw,
    )


def false_alarms(reading: Reading) -> Drawing | None:
    """False alarms of each detector on streams without drift; None without such streams."""
    quiet = _quiet(reading.study)
    if not quiet:
        return None
    rows, stated = [], set()
    words = []
    for (model, detector), results in quiet.items():
        events, exposure = alarms(results)
        estimate = rate(events, exposure)
        rows.append(Dots(pair(model, detector), model, {"rate": estimate}))
        if detector == "calibrated":
            every = float(results[0].case.resolved[STATED])
            stated.add(1 / every)
            inside = estimate.low <= 1 / every <= estimate.high
            words.append(
                f"Stated for the calibrated detector ({model}): one in {every:g}; observed: "
                f"{events} in {exposure} experiments, 95 % interval one in "
                f"{_every(estimate.high)} to one in {_every(estimate.low)}, which "
                f"{'holds' if inside else 'does not hold'} what was stated."
            )
    lines = [("stated", value) for value in sorted(stated)]
    highest = max([r.values["rate"].high for r in rows] + [value for _, value in lines])
    panel = Panel("rate", "false alarms an experiment", (0, 1.05 * highest), lines)

    def draw(layout: Layout) -> Figure:
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


def kinds(reading: Reading) -> Drawing | None:
    """What is left of the error, recall and precision for each kind of drift."""
    study = reading.study
    rows: list[Dots] = []
    least: list[str] = []
    for label, group in by_kind(study).items():
        rows.append(Dots(label))
        best: tuple[float, str] | None = None
        for model, detector in dict.fromkeys((r.case.model, r.case.detector) for r in group):
            own = [r for r in group if (r.case.model, r.case.detector) == (model, detector)]
            share = reading.of(own, "share")
            values = {"share": share, "mme": reading.of(own, "mme")}
            values |= {k: reading.of(own, k) for k in ("recall", "recall_detectable", "precision")}
            known = {k: v for k, v in values.items() if v.value is not None}
            rows.append(Dots(pair(model, detector), model, known))
            if share.value is not None and (best is None or share.value < best[0]):
                best = share.value, f"{label}: {model} {100 * share.value:.0f} %"
        if best:
            least.append(best[1])
    if not rows:
        return None
    shown = (
        Panel("share", "share of the original's MME"),
        Panel("recall", "recall", (0, 1)),
        Panel("precision", "precision", (0, 1)),
    )

    def draw(layout: Layout) -> Figure:
        figure = dot_plot(layout, rows, shown, columns=3)
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


def by_kind(study: Study) -> dict[str, list[Result]]:
    """The group `kinds`, by what wears how and from which start."""
    found: dict[str, list[Result]] = {}
    for result in study.results("kinds"):
        resolved = result.case.resolved
        kind = resolved["degradation"] or "staircase"
        start = resolved["start"]
        label = f"{kind}, start {start}" if start else kind
        found.setdefault(label, []).append(result)
    return found


def alarms(results: list[Result]) -> tuple[int, int]:
    """(positives, experiments) of runs without drift."""
    return sum(len(r.positives) for r in results), sum(len(r.number) for r in results)


def _quiet(study: Study) -> dict[tuple[str, str], list[Result]]:
    found: dict[tuple[str, str], list[Result]] = {}
    for result in study.results("control"):
        if len(set(result.truth)) == 1 and result.case.alarms is None:
            found.setdefault((result.case.model, result.case.detector), []).append(result)
    return found


def _samples(results: list[Result]) -> int:
    kept = [len(rows["time"] or ()) for r in results for rows in r.kept.values()]
    return kept[0] if kept else SAMPLES


def _every(per_experiment: float) -> str:
    return number(1 / per_experiment) if per_experiment > 0 else "∞"
