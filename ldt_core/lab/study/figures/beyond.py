"""Beyond the paper: what each learner leaves of the original's error, and the floors below it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ldt_core.base.sentences import number
from ldt_core.lab.study.case import Result
from ldt_core.lab.study.drift_detection import drifts_of
from ldt_core.lab.study.figures.dots import Dots, Panel, dot_plot, key_to_marks
from ldt_core.lab.study.figures.reading import Reading
from ldt_core.lab.study.figures.series import first_seed, of_seed
from ldt_core.lab.study.statistics import Estimate, mean
from ldt_core.views.page.style import (
    FAINT,
    INK,
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

#: MME of the paper's table 1 [rad/s].
PAPER_MME = {"linear": 8.86, "hybrid": 6.86, "original": 10.09}


def shares(reading: Reading) -> Drawing | None:
    """MME as a share of the original's; None without runs."""
    rows = [Dots("the paper, on its rotor")]
    for model in ("linear", "hybrid"):
        share = PAPER_MME[model] / PAPER_MME["original"]
        exact = {"share": Estimate(100 * share, -np.inf, np.inf, 1)}
        rows.append(Dots(model, model, exact, hollow=True))
    best: tuple[float, str] | None = None
    for group, heading in (("paper", "here, as in the paper"), ("better", "here, beyond it")):
        pairs = reading.study.pairs(group)
        rows += [Dots(heading)] if pairs else []
        for model, detector in pairs:
            results = reading.study.results(group, model=model, detector=detector)
            estimate = _percent(reading.of(results, "share"))
            name = pair(model, detector)
            rows.append(Dots(name, model, {"share": estimate}))
            if estimate.value is not None and (best is None or estimate.value < best[0]):
                best = estimate.value, f"{name}: {estimate.text('%')}"
    if best is None:
        return None
    floors = _floors(reading)
    panel = Panel("share", "MME [% of the original model's]", (0, 105), floors)
    words = "".join(f"; {label}: {value:.1f} %" for label, value in floors)

    def draw(layout: Layout) -> Figure:
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


def over_stream(reading: Reading) -> Drawing | None:
    """The error in each experiment of one stream; None without runs beyond the paper."""
    results = reading.study.results("better")
    if not results:
        return None
    seed = first_seed(results)
    chosen: dict[str, Result] = {}
    for result in of_seed(results, seed):
        case = result.case
        if reading.best(case.model) == (case.model, case.detector):
            chosen[case.model] = result
    sample = next(iter(chosen.values()))
    drifts = drifts_of(sample.truth, sample.number[0])
    facts = reading.study.facts_of(sample)

    def draw(layout: Layout) -> Figure:
        figure, (axes,) = panels(layout, 3.6)
        for index, drift in enumerate(drifts):
            label = "drift" if index == 0 else None
            axes.axvline(drift - 0.5, color=FAINT, lw=1.6, zorder=0, label=label)
        axes.grid(axis="x", visible=False)
        axes.plot(sample.number, sample.original, **look("original").plot(lw=1.3))
        for model, result in chosen.items():
            axes.plot(result.number, result.max_error, **look(model).plot(lw=1.3))
        if facts is not None:
            axes.plot(
                sample.number, facts.floor, color=INK, lw=1.2, ls=":", label="floor: true model"
            )
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(power)
        axes.set_xlim(sample.number[0] - 0.5, sample.number[-1] + 0.5)
        axes.set_xlabel("experiment")
        axes.set_ylabel("maximum error [rad/s]")
        legend(figure, [axes], layout, 6)
        return figure

    words = ", ".join(
        f"{model} ({look(r.case.detector).label} detector) {number(_mme(r))}"
        for model, r in chosen.items()
    )
    return Drawing(
        "over_stream",
        "The error over one stream",
        f"Seed {seed}; each model with the detector that serves it best over all seeds. "
        f"MME [rad/s]: original {number(float(np.mean(sample.original)))}, {words}.",
        "Maximum error over the experiments on a logarithmic scale, for the original model and "
        "the learners, with the drifts marked.",
        draw,
    )


def _mme(result: Result) -> float:
    return float(np.mean(result.max_error))


def _percent(e: Estimate) -> Estimate:
    value = None if e.value is None else 100 * e.value
    return Estimate(value, 100 * e.low, 100 * e.high, e.count)


def _floors(reading: Reading) -> list[tuple[str, float]]:
    """(label, per cent of the original's MME) of the floors, mean over the streams."""
    true, late = [], []
    for result in {r.case.seed: r for r in reading.study.results("better")}.values():
        facts = reading.study.facts_of(result)
        if facts is not None:
            original = float(np.mean(result.original))
            true.append(100 * facts.mme_floor / original)
            late.append(100 * facts.mme_late / original)
    found = (
        ("floor: true e", mean(true).value),
        ("floor: true e, one late", mean(late).value),
    )
    return [(label, value) for label, value in found if value is not None]
