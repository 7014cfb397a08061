"""Streams over their experiments: voltage and speed, wear, error, which drifts were found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ldt_core.base.sentences import counted, number
from ldt_core.lab.study.drift_detection import detection, drifts_of
from ldt_core.lab.study.facts import Drift, energy_needed
from ldt_core.lab.study.figures.wear import wear
from ldt_core.lab.study.study import Evidence
from ldt_core.lab.study.study_case import RunResult
from ldt_core.views.page.style import (
    FAINT,
    GREEN,
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
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Samples an experiment has when the study kept none to count.
SAMPLES = 2000
#: Shown; a drift that does less, or more, to the speed lies on the edge.
LEAST_ENERGY, MOST_ENERGY = 1e-2, 1e12


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
            pale = {"color": GREY, "alpha": 0.45, "lw": 1, "label": label}
            _stairs(axes, other, quantity.scaled(other.truth), **pale)
        values = quantity.scaled(shown.truth)
        _stairs(axes, shown, values, color=VERMILION, lw=2, label=f"seed {seed}")
        axes.set_xlabel("experiment")
        axes.set_ylabel(quantity.label)
        axes.set_xlim(shown.number[0] - 0.5, shown.number[-1] + 0.5)
        axes.set_ylim(bottom=0)
        axes.legend(loc="upper left")
        return figure

    held = np.diff([shown.number[0], *drifts, shown.number[-1] + 1])
    span = f"{held.min()} to " if held.min() < held.max() else ""
    return Drawing(
        "staircase",
        "How the machine wears over the stream",
        f"{quantity.name} rises from {quantity.text(min(shown.truth))} to "
        f"{quantity.text(max(shown.truth))} in {counted(len(drifts), 'drift')}; each level is held "
        f"for {span}{counted(int(held.max()), 'experiment')} (seed {seed}). The twin never sees "
        "it.",
        f"A staircase over {counted(len(shown.number), 'experiment')}, with steps of random "
        "length.",
        draw,
    )


def _stairs(axes: Axes, run: RunResult, values: np.ndarray, **look: Any) -> None:
    """A value of each experiment, as wide as the experiment, the last one too."""
    edges = np.append(run.number, run.number[-1] + 1) - 0.5
    axes.stairs(values, edges, baseline=None, **look)


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
            label = "reference: true model"
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


def detectable(evidence: Evidence) -> Drawing | None:
    """Energy of each drift against what wears; None without facts or runs beyond the paper."""
    best = evidence.best()
    if best is None:
        return None
    results = evidence.study.pairs("better")[best]
    points: list[tuple[Drift, bool]] = []
    for result in results:
        facts = evidence.study.facts_of(result)
        for drift in facts.drifts if facts else ():
            points.append((drift, bool(detection([drift.number], result.positives).detected)))
    if not points:
        return None
    quantity = wear(results[0])
    kept = [len(rows["time"]) for r in results for rows in r.kept.values()]
    needed = energy_needed(kept[0] if kept else SAMPLES)
    visible = [found for drift, found in points if drift.detectable]
    hidden = [found for drift, found in points if not drift.detectable]
    beneath = (
        f"Of {len(hidden)} that one experiment of a drift does not show above the noise, "
        f"{sum(hidden)}: by chance, or over several experiments. "
        if hidden
        else ""
    )

    def draw(layout: Layout) -> Figure:
        figure, (axes,) = panels(layout, 3.6)
        for found, label, color, marker in (
            (True, f"detected ({sum(f for _, f in points)})", GREEN, "o"),
            (False, f"missed ({sum(not f for _, f in points)})", VERMILION, "x"),
        ):
            chosen = [d for d, f in points if f is found]
            x = quantity.scaled([d.after for d in chosen])
            y = [min(max(d.energy, LEAST_ENERGY), MOST_ENERGY) for d in chosen]
            axes.plot(x, y, marker, color=color, mfc="none", label=label, mew=1.3)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(power)
        axes.axhline(needed, color=INK, lw=1.2, ls=(0, (5, 2)), label="detectable from here on")
        axes.set_xlabel(quantity.label)
        axes.set_ylabel("energy of the drift |Δy|² / σ²")
        legend(figure, [axes], layout, 4)
        return figure

    return Drawing(
        "detectable",
        "Which drifts can be found, and which were",
        f"{pair(*best)} detector: {sum(visible)} of {len(visible)} detectable drifts detected. "
        f"{beneath}Each drift stands at the value of {quantity.symbol} that it leads to.",
        "Energy of each drift on a logarithmic scale against the eccentricity after it, marked by "
        "whether it was detected, with the limit above which it is detectable.",
        draw,
    )


def _first(results: Sequence[RunResult]) -> RunResult:
    """The first of the smallest seed, which a figure of a single stream shows."""
    return min(results, key=lambda r: r.case.seed)
