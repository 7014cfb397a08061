"""What the diagnosed model takes the cause to be, beside the truth."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ldt_core.base.sentences import number
from ldt_core.lab.study.case import Result
from ldt_core.lab.study.figures.reading import Reading
from ldt_core.lab.study.figures.series import first_seed, of_seed, wear
from ldt_core.lab.study.statistics import mean
from ldt_core.views.page.style import Drawing, Layout, legend, look, pair, panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def over_stream(reading: Reading) -> Drawing | None:
    """Estimate and truth over one stream; None without the diagnosed model."""
    best = reading.best("diagnosed")
    if best is None:
        return None
    model, detector = best
    alike = reading.study.results("better", model=model, detector=detector)
    if not any(e is not None for r in alike for e in r.estimate):
        return None
    shown = of_seed(alike, first_seed(alike))[0]
    quantity = wear(shown)
    truth = quantity.scaled(shown.truth)
    estimate = quantity.scaled([np.nan if e is None else e for e in shown.estimate])

    def draw(layout: Layout) -> Figure:
        figure, (upper, lower) = panels(
            layout, 1.0, count=2, sharex=True, gridspec_kw={"height_ratios": (2, 1)}
        )
        figure.set_figheight(4.4)
        style = look("measured").plot(lw=2.4, label="true")
        upper.step(shown.number, truth, where="mid", **style)
        name = f"estimate, {model} model"
        style = look(model).plot(label=name)
        upper.step(shown.number, estimate, where="mid", **style)
        upper.set_ylabel(quantity.label)
        style.pop("label")
        lower.step(shown.number, estimate - truth, where="mid", **style)
        lower.set_ylabel(f"estimate − true\n[{quantity.unit}]")
        lower.set_xlabel("experiment")
        lower.set_xlim(shown.number[0], shown.number[-1])
        legend(figure, [upper], layout)
        figure.align_ylabels()
        return figure

    return Drawing(
        "estimate",
        "The cause as the twin sees it",
        f"{pair(model, detector)} detector, seed {shown.case.seed}: the value of {quantity.symbol} "
        "in the model that predicts each experiment, beside the true one. "
        f"{_finding(alike, quantity.scale, quantity.unit)}",
        "Two staircases over the experiments, the true eccentricity and the estimated one, and "
        "their difference below.",
        draw,
    )


def _finding(results: list[Result], scale: float, unit: str) -> str:
    """Errors over all seeds: everywhere, and where the machine is as in the experiment before."""
    everywhere, settled = [], []
    for result in results:
        truth = np.array(result.truth)
        estimate = np.array([np.nan if e is None else e for e in result.estimate])
        error = scale * np.abs(estimate - truth)
        known = np.isfinite(error)
        same = np.r_[False, truth[1:] == truth[:-1]]
        everywhere.append(float(np.median(error[known])))
        if np.any(known & same):
            settled.append(float(np.mean(error[known & same])))
    return (
        f"Median error {number(float(np.median(everywhere)))} {unit} (median over "
        f"{len(results)} seeds); mean error in experiments in which nothing has changed since the "
        f"one before: {mean(settled).text(unit)}."
    )
