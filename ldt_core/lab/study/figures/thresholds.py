"""The influence of the threshold, four panels (paper, figure 9)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ldt_core.lab.study.case import Result
from ldt_core.lab.study.figures.levels import band, top
from ldt_core.lab.study.figures.reading import Reading
from ldt_core.lab.study.figures.series import Curve
from ldt_core.lab.study.study import Study
from ldt_core.views.page.style import Drawing, Layout, legend, panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Detector → its parameter that is swept, and its name in the paper.
SWEPT = {"threshold": ("threshold", r"$\theta_c$"), "lddm": ("error_threshold", r"$\theta_d$")}
TITLES = {"threshold": "threshold detector", "lddm": "LDDM"}
MODELS = ("linear", "hybrid")
TICKS = 8  # labels at most on a panel
Sweep = dict[tuple[str, str], tuple[Curve, Curve]]


def influence(reading: Reading) -> Drawing | None:
    """MME and adaptations against the threshold; None without the sweep."""
    study = reading.study
    sweeps = _sweeps(study)
    if not sweeps:
        return None
    detectors = [d for d in SWEPT if any(key[1] == d for key in sweeps)]
    seeds = len({r.case.seed for r in study.results("sweep")})

    def draw(layout: Layout) -> Figure:
        count = 2 * len(detectors)
        figure, axes = panels(layout, 2.5, columns=len(detectors), count=count)
        for index, one in enumerate(axes):
            # Wide: a row a quantity, as in the paper. Narrow: the same order down the page.
            row, detector = index // len(detectors), detectors[index % len(detectors)]
            for model in MODELS:
                if (model, detector) in sweeps:
                    curve = sweeps[model, detector][row]
                    band(one, curve.x, curve, model)
            one.set_xscale("log")
            ticks = sorted({x for k, c in sweeps.items() if k[1] == detector for x in c[0].x})
            _ticks(one, ticks)
            one.set_title(f"({'abcd'[index]}) {TITLES[detector]}")
            one.set_xlabel(f"threshold {SWEPT[detector][1]} [rad/s]", parse_math=True)
            one.set_ylabel("MME [rad/s]" if row == 0 else "adaptations a run")
            one.set_ylim(0, top(c[row] for k, c in sweeps.items() if k[1] == detector))
        legend(figure, axes, layout)
        return figure

    note = f" Mean over {seeds} seeds, band: 95 % confidence interval." if seeds > 1 else ""
    return Drawing(
        "thresholds",
        "The influence of the threshold",
        f"{' '.join(_finding(key, *curves) for key, curves in sweeps.items())}{note}",
        "Four panels: mean maximum error (above) and adaptations (below) against the threshold, "
        "for the threshold detector (left) and LDDM (right), linear and hybrid model.",
        draw,
    )


def _sweeps(study: Study) -> Sweep:
    found: Sweep = {}
    for model in MODELS:
        for detector, (parameter, _) in SWEPT.items():
            groups: dict[float, list[Result]] = {}
            for result in study.results("sweep", model=model, detector=detector):
                groups.setdefault(float(result.case.resolved[parameter]), []).append(result)
            if len(groups) > 1:
                grid = sorted(groups)
                mme = [[float(np.mean(r.max_error)) for r in groups[x]] for x in grid]
                count = [[float(len(r.adaptations)) for r in groups[x]] for x in grid]
                curves = Curve.over_seeds(grid, mme), Curve.over_seeds(grid, count)
                found[model, detector] = curves
    return found


def _finding(key: tuple[str, str], mme: Curve, count: Curve) -> str:
    model, detector = key
    best = int(np.argmin(mme.mean))
    return (
        f"{TITLES[detector][0].upper()}{TITLES[detector][1:]}, {model}: least MME "
        f"{mme.mean[best]:.2f} at {mme.x[best]:g} rad/s, with {count.mean[best]:.1f} adaptations; "
        f"over the range {mme.mean.min():.2f} to {mme.mean.max():.2f}."
    )


def _ticks(axes: object, values: list[float]) -> None:
    from matplotlib.axes import Axes
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    assert isinstance(axes, Axes)
    chosen = values if len(values) <= TICKS else values[:: -(-len(values) // TICKS)]
    axes.xaxis.set_major_locator(FixedLocator(chosen))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
