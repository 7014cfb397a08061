"""MME and adaptations against what wears, for each detector (paper, figures 7 and 8)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ldt_core.lab.study.case import Result
from ldt_core.lab.study.figures.dots import ROOM
from ldt_core.lab.study.figures.reading import Reading
from ldt_core.lab.study.figures.series import Curve, by_level, wear
from ldt_core.lab.study.study import Study
from ldt_core.views.page.style import Drawing, Layout, legend, look, panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DETECTORS = ("window", "threshold", "lddm")
Mask = NDArray[np.bool_]


def mme(result: Result, mask: Mask) -> float:
    """Mean maximum error of the twin in the experiments of the mask [rad/s]."""
    return float(np.mean(np.array(result.max_error)[mask]))


def mme_original(result: Result, mask: Mask) -> float:
    """The same of the original model."""
    return float(np.mean(np.array(result.original)[mask]))


def adaptations(result: Result, mask: Mask) -> float:
    """New models that came into force in the experiments of the mask."""
    numbers = np.array(result.number)[mask]
    return float(np.isin(numbers, result.adaptations).sum())


def mme_by_level(reading: Reading) -> Drawing | None:
    """MME of the hybrid model; None without the paper's runs of it."""
    study = reading.study
    curves = _curves(study, mme)
    if not curves:
        return None
    original = by_level(study.results("paper", model="hybrid"), mme_original)
    curves = {"original": original, **curves}
    last = {look(n).label: c.mean[-1] for n, c in curves.items()}
    found = ", ".join(f"{n} {v:.1f}" for n, v in last.items())
    return _drawing(
        study,
        "mme_by_level",
        "Error against the wear, by detector (hybrid model)",
        f"At the highest level the MME is [rad/s]: {found}. {_below(curves)}",
        "mean maximum error [rad/s]",
        curves,
    )


def adaptations_by_level(reading: Reading) -> Drawing | None:
    """Adaptations of the hybrid model; None without the paper's runs of it."""
    study = reading.study
    curves = _curves(study, adaptations)
    if not curves:
        return None
    halves = []
    for name, curve in curves.items():
        middle = len(curve.x) // 2
        low, high = curve.mean[:middle].sum(), curve.mean[middle:].sum()
        halves.append(f"{look(name).label} {low:.1f} and {high:.1f}")
    return _drawing(
        study,
        "adaptations_by_level",
        "Adaptations against the wear, by detector (hybrid model)",
        f"Adaptations a run in the lower and in the upper half of the levels: {'; '.join(halves)}.",
        "adaptations in a level",
        curves,
    )


def _curves(study: Study, value: Callable[[Result, Mask], float]) -> dict[str, Curve]:
    groups = {d: study.results("paper", model="hybrid", detector=d) for d in DETECTORS}
    return {d: by_level(results, value) for d, results in groups.items() if results}


def _below(curves: dict[str, Curve]) -> str:
    """Over how many levels each detector's mean lies below the original's."""
    original = curves["original"].mean
    words = [
        f"{look(n).label} {int(np.sum(c.mean < original))}"
        for n, c in curves.items()
        if n != "original"
    ]
    return f"Levels (of {len(original)}) with a mean below the original's: {', '.join(words)}."


def _drawing(
    study: Study, name: str, title: str, caption: str, label: str, curves: dict[str, Curve]
) -> Drawing:
    sample = study.results("paper", model="hybrid")
    quantity, seeds = wear(sample[0]), len({r.case.seed for r in sample})

    def draw(layout: Layout) -> Figure:
        figure, (axes,) = panels(layout, 3.4)
        for key, curve in curves.items():
            band(axes, quantity.scaled(list(curve.x)), curve, key)
        axes.set_xlabel(quantity.label)
        axes.set_ylabel(label)
        axes.set_ylim(0, top(curves.values()))
        legend(figure, [axes], layout)
        return figure

    note = f" Mean over {seeds} seeds, band: 95 % confidence interval." if seeds > 1 else ""
    alt = f"Curves over {quantity.label}: {label}, for {', '.join(look(n).label for n in curves)}."
    return Drawing(name, title, caption + note, alt, draw)


def top(curves: Iterable[Curve]) -> float:
    """Of an axis that shows all means, and of intervals that are wider than all means a part."""
    rows = list(curves)
    highest = max(float(c.mean.max()) for c in rows)
    return 1.05 * min(max(float(c.high.max()) for c in rows), ROOM * highest) or 1.0


def band(axes: Axes, x: NDArray[np.float64], curve: Curve, key: str) -> None:
    """A curve with its confidence band, in the style of a model or detector."""
    style = look(key)
    axes.plot(x, curve.mean, **style.plot(marker=style.marker))
    axes.fill_between(x, curve.low, curve.high, color=style.color, alpha=0.18, lw=0)
