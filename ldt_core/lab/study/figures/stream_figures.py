"""One stream over its experiments: how the machine wears, the error, the cause as it is seen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ldt_core.base.sentences import number
from ldt_core.lab.study.drift_detection import drifts_of
from ldt_core.lab.study.evidence import Evidence
from ldt_core.lab.study.figures.wear import WearQuantity, wear
from ldt_core.lab.study.statistics import mean
from ldt_core.lab.study.study_case import RunResult
from ldt_core.views.page.style import (
    FAINT,
    GREY,
    INK,
    VERMILION,
    Drawing,
    Layout,
    legend,
    look,
    pair,
    panels,
    power,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def input_output(evidence: Evidence) -> Drawing | None:
    """Voltage and speed of one experiment (paper, figure 4); None where the study kept none."""
    kept = [(r, n) for r in evidence.study.results() for n in sorted(r.kept)]
    if not kept:
        return None
    result, shown = kept[0]
    rows = result.kept[shown]
    time, voltage, speed = (np.array(rows[n]) for n in ("time", "voltage", "speed"))
    worn = wear(result).text(result.truth[result.number.index(shown)])

    def draw(layout: Layout) -> Figure:
        figure, (upper, lower) = panels(layout, 1.9, columns=1, count=2, sharex=True)
        upper.step(time, voltage, where="post", color=INK, lw=1.2)
        upper.set_ylabel("voltage $V_s$ [V]", parse_math=True)
        lower.plot(time, speed, **look("measured").plot(lw=1.2))
        lower.set_ylabel("speed ω [rad/s]")
        lower.set_xlabel("time [s]")
        lower.set_xlim(time[0], time[-1])
        figure.align_ylabels()
        return figure

    return Drawing(
        "input_output",
        "Input and output of an experiment",
        f"Experiment {shown} of seed {result.case.seed}, {worn}: a random voltage between "
        f"{voltage.min():.1f} and {voltage.max():.1f} V in, the speed of the motor out "
        f"(at most {speed.max():.1f} rad/s).",
        "Two curves over time: a stepped voltage, and the speed that follows it.",
        draw,
    )


def staircase(evidence: Evidence) -> Drawing | None:
    """What wears, over the stream (paper, figure 5); None without runs."""
    study = evidence.study
    results = study.results("paper") or study.results("better") or study.results()
    if not results:
        return None
    shown = _first(results)
    seed = shown.case.seed
    others = list({r.case.seed: r for r in results if r.case.seed != seed}.values())
    quantity = wear(shown)
    drifts = drifts_of(shown.truth, shown.number[0])

    def draw(layout: Layout) -> Figure:
        figure, (axes,) = panels(layout, 2.8)
        for index, other in enumerate(others):
            count = f"{len(others)} seeds" if len(others) > 1 else "seed"
            label = f"the other {count}" if index == 0 else None
            values = quantity.scaled(other.truth)
            axes.step(other.number, values, where="post", color=GREY, alpha=0.45, lw=1, label=label)
        values = quantity.scaled(shown.truth)
        axes.step(shown.number, values, where="post", color=VERMILION, label=f"seed {seed}", lw=2)
        axes.set_xlabel("experiment")
        axes.set_ylabel(quantity.label)
        axes.set_xlim(shown.number[0], shown.number[-1])
        axes.set_ylim(bottom=0)
        axes.legend(loc="upper left")
        return figure

    held = np.diff([shown.number[0], *drifts, shown.number[-1] + 1])
    return Drawing(
        "staircase",
        "How the machine wears over the stream",
        f"{quantity.name} rises from {quantity.text(min(shown.truth))} to "
        f"{quantity.text(max(shown.truth))} in {len(drifts)} drifts; each level is held for "
        f"{held.min()} to {held.max()} experiments (seed {seed}). The twin never sees it.",
        f"A staircase over {len(shown.number)} experiments, with steps of random length.",
        draw,
    )


def over_stream(evidence: Evidence) -> Drawing | None:
    """The error in each experiment of one stream; None without runs beyond the paper."""
    results = evidence.study.results("better")
    if not results:
        return None
    seed = _first(results).case.seed
    chosen: dict[str, RunResult] = {}
    for result in results:
        case = result.case
        if case.seed == seed and evidence.best(case.model) == (case.model, case.detector):
            chosen[case.model] = result
    sample = next(iter(chosen.values()))
    facts = evidence.study.facts_of(sample)

    def draw(layout: Layout) -> Figure:
        figure, (axes,) = panels(layout, 3.6)
        for index, drift in enumerate(drifts_of(sample.truth, sample.number[0])):
            label = "drift" if index == 0 else None
            axes.axvline(drift - 0.5, color=FAINT, lw=1.6, zorder=0, label=label)
        axes.grid(axis="x", visible=False)
        axes.plot(sample.number, sample.original, **look("original").plot(lw=1.3))
        for model, result in chosen.items():
            axes.plot(result.number, result.max_error, **look(model).plot(lw=1.3))
        if facts is not None:
            label = "floor: true model"
            axes.plot(sample.number, facts.floor, color=INK, lw=1.2, ls=":", label=label)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(power)
        axes.set_xlim(sample.number[0] - 0.5, sample.number[-1] + 0.5)
        axes.set_xlabel("experiment")
        axes.set_ylabel("maximum error [rad/s]")
        legend(figure, [axes], layout, 6)
        return figure

    words = ", ".join(
        f"{model} ({look(r.case.detector).label} detector) {number(evidence.run(r).score.mme)}"
        for model, r in chosen.items()
    )
    return Drawing(
        "over_stream",
        "The error over one stream",
        f"Seed {seed}; each model with the detector that serves it best over all seeds. "
        f"MME [rad/s]: original {number(evidence.run(sample).score.mme_original)}, {words}.",
        "Maximum error over the experiments on a logarithmic scale, for the original model and "
        "the learners, with the drifts marked.",
        draw,
    )


def estimate(evidence: Evidence) -> Drawing | None:
    """Estimate and truth over one stream; None without the diagnosed model."""
    best = evidence.best("diagnosed")
    alike = evidence.study.pairs("better")[best] if best else []
    if best is None or not any(e is not None for r in alike for e in r.estimate):
        return None
    shown, quantity = _first(alike), wear(alike[0])
    truth = quantity.scaled(shown.truth)
    seen = quantity.scaled(_estimates(shown))

    def draw(layout: Layout) -> Figure:
        figure, (upper, lower) = panels(
            layout, 1.0, count=2, sharex=True, gridspec_kw={"height_ratios": (2, 1)}
        )
        figure.set_figheight(4.4)
        style = look("measured").plot(lw=2.4, label="true")
        upper.step(shown.number, truth, where="mid", **style)
        style = look(best[0]).plot(label=f"estimate, {best[0]} model")
        upper.step(shown.number, seen, where="mid", **style)
        upper.set_ylabel(quantity.label)
        style.pop("label")
        lower.step(shown.number, seen - truth, where="mid", **style)
        lower.set_ylabel(f"estimate − true\n[{quantity.unit}]")
        lower.set_xlabel("experiment")
        lower.set_xlim(shown.number[0], shown.number[-1])
        legend(figure, [upper], layout)
        figure.align_ylabels()
        return figure

    return Drawing(
        "estimate",
        "The cause as the twin sees it",
        f"{pair(*best)} detector, seed {shown.case.seed}: the value of {quantity.symbol} "
        "in the model that predicts each experiment, beside the true one. "
        f"{_errors_of_estimates(alike, quantity)}",
        "Two staircases over the experiments, the true eccentricity and the estimated one, and "
        "their difference below.",
        draw,
    )


def _first(results: Sequence[RunResult]) -> RunResult:
    """The first of the smallest seed, which a figure of a single stream shows."""
    return min(results, key=lambda r: r.case.seed)


def _estimates(result: RunResult) -> list[float]:
    return [np.nan if e is None else e for e in result.estimate]


def _errors_of_estimates(results: Sequence[RunResult], quantity: WearQuantity) -> str:
    """Over all seeds: everywhere, and where the machine is as in the experiment before."""
    everywhere, settled = [], []
    for result in results:
        truth = np.array(result.truth)
        error = quantity.scale * np.abs(np.array(_estimates(result)) - truth)
        known = np.isfinite(error)
        same = np.r_[False, truth[1:] == truth[:-1]]
        everywhere.append(float(np.median(error[known])))
        if np.any(known & same):
            settled.append(float(np.mean(error[known & same])))
    return (
        f"Median error {number(float(np.median(everywhere)))} {quantity.unit} (median over "
        f"{len(results)} seeds); mean error in experiments in which nothing has changed since the "
        f"one before: {mean(settled).text(quantity.unit)}."
    )
