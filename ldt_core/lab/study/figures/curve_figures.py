"""Curves over seeds with their band: against what wears, and against the threshold."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ldt_core.lab.statistics import mean
from ldt_core.lab.study.figures.wear import wear
from ldt_core.lab.study.study import Evidence
from ldt_core.lab.study.study_case import RunResult
from ldt_core.lab.study.study_plan import PAPER_MODELS
from ldt_core.views.page.style import Drawing, Layout, legend, look, panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DETECTORS = ("window", "threshold", "lddm")
#: Swept detector → its title, and the name of its threshold in the paper.
SWEPT = {"threshold": ("threshold detector", r"$\theta_c$"), "lddm": ("LDDM", r"$\theta_d$")}
TICKS = 8  # labels at most on a panel
ROOM = 1.5  # times the largest mean, at most, is the end of an axis

Row = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class SeedCurve:
    """A quantity over a grid, with its mean and interval over the seeds at each point.

    Attributes:
        x: (n,) grid.
        mean: (n,)
        low: (n,) of the 95 % confidence interval of the mean; the mean where one seed is there.
        high: (n,)
    """

    x: Row
    mean: Row
    low: Row
    high: Row

    @classmethod
    def over_seeds(cls, x: Sequence[float], values: Iterable[Sequence[float]]) -> SeedCurve:
        """From one row of values a grid point."""
        found = [mean(v) for v in values]
        middle = np.array([e.value for e in found], dtype=np.float64)
        low = np.array([e.low if np.isfinite(e.low) else e.value for e in found], dtype=float)
        high = np.array([e.high if np.isfinite(e.high) else e.value for e in found], dtype=float)
        return cls(np.asarray(x, dtype=np.float64), middle, low, high)


def mme_by_level(evidence: Evidence) -> Drawing | None:
    """MME of the hybrid model (paper, figure 7); None without the paper's runs of it."""

    def mme(result: RunResult, mask: Mask) -> float:
        return float(np.mean(np.array(result.max_error)[mask]))

    def mme_original(result: RunResult, mask: Mask) -> float:
        return float(np.mean(np.array(result.original)[mask]))

    curves = _of_hybrid(evidence, mme)
    if not curves:
        return None
    original = _by_level(evidence.study.results("paper", model="hybrid"), mme_original)
    below = [f"{look(n).label} {int(np.sum(c.mean < original.mean))}" for n, c in curves.items()]
    curves = {"original": original, **curves}
    found = ", ".join(f"{look(n).label} {c.mean[-1]:.1f}" for n, c in curves.items())
    return _against_wear(
        evidence,
        "mme_by_level",
        "Error against the wear, by detector (hybrid model)",
        f"At the highest level the MME is [rad/s]: {found}. Levels (of {len(original.mean)}) with "
        f"a mean below the original's: {', '.join(below)}.",
        "mean maximum error [rad/s]",
        curves,
    )


def adaptations_by_level(evidence: Evidence) -> Drawing | None:
    """Adaptations of the hybrid model (paper, figure 8); None without the paper's runs of it."""

    def adaptations(result: RunResult, mask: Mask) -> float:
        return float(np.isin(np.array(result.number)[mask], result.adaptations).sum())

    curves = _of_hybrid(evidence, adaptations)
    if not curves:
        return None
    return _against_wear(
        evidence,
        "adaptations_by_level",
        "Adaptations against the wear, by detector (hybrid model)",
        "Adaptations of a run while the machine is at each level.",
        "adaptations in a level",
        curves,
    )


def thresholds(evidence: Evidence) -> Drawing | None:
    """MME and adaptations against the threshold (paper, figure 9); None without the sweep."""
    sweeps: dict[tuple[str, str], tuple[SeedCurve, SeedCurve]] = {}
    for model in PAPER_MODELS:
        for detector in SWEPT:
            runs = evidence.sweep(model, detector)
            if len(runs) > 1:
                scores = [[r.score for r in by_seed.values()] for by_seed in runs.values()]
                mme = [[s.mme for s in row] for row in scores]
                count = [[s.adaptations for s in row] for row in scores]
                sweeps[model, detector] = (
                    SeedCurve.over_seeds(list(runs), mme),
                    SeedCurve.over_seeds(list(runs), count),
                )
    if not sweeps:
        return None
    detectors = [d for d in SWEPT if any(key[1] == d for key in sweeps)]

    def draw(layout: Layout) -> Figure:
        count = 2 * len(detectors)
        figure, axes = panels(layout, 2.5, columns=len(detectors), count=count)
        for index, one in enumerate(axes):
            # Wide: a row a quantity, as in the paper. Narrow: the same order down the page.
            row, detector = index // len(detectors), detectors[index % len(detectors)]
            shown = {m: sweeps[m, detector][row] for m in PAPER_MODELS if (m, detector) in sweeps}
            for model, curve in shown.items():
                _band(one, curve.x, curve, model)
            title, symbol = SWEPT[detector]
            one.set_xscale("log")
            values = sorted({x for curve in shown.values() for x in curve.x})
            ticks = values if len(values) <= TICKS else values[:: -(-len(values) // TICKS)]
            one.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
            one.set_xticks([], minor=True)
            one.set_title(f"({'abcd'[index]}) {title}")
            one.set_xlabel(f"threshold {symbol} [rad/s]", parse_math=True)
            one.set_ylabel("MME [rad/s]" if row == 0 else "adaptations a run")
            one.set_ylim(0, _top(shown.values()))
        legend(figure, axes, layout)
        return figure

    return Drawing(
        "thresholds",
        "The influence of the threshold",
        f"{' '.join(_least(*key, *curves) for key, curves in sweeps.items())}"
        f"{_note(evidence.study.results('sweep'))}",
        "Four panels: mean maximum error (above) and adaptations (below) against the threshold, "
        "for the threshold detector (left) and LDDM (right), linear and hybrid model.",
        draw,
    )


def _of_hybrid(
    evidence: Evidence, value: Callable[[RunResult, Mask], float]
) -> dict[str, SeedCurve]:
    groups = {d: evidence.study.results("paper", model="hybrid", detector=d) for d in DETECTORS}
    return {d: _by_level(results, value) for d, results in groups.items() if results}


def _by_level(results: Sequence[RunResult], value: Callable[[RunResult, Mask], float]) -> SeedCurve:
    """A figure of merit for each level of what wears, over the seeds.

    Args:
        results: one a seed.
        value: of a run, in the experiments that a mask over its rows picks.
    """
    levels = sorted({round(v, 9) for r in results for v in r.truth})
    rows = []
    for level in levels:
        masks = [(r, np.isclose(r.truth, level, atol=1e-9)) for r in results]
        rows.append([value(r, mask) for r, mask in masks if mask.any()])
    return SeedCurve.over_seeds(levels, rows)


def _against_wear(
    evidence: Evidence,
    name: str,
    title: str,
    caption: str,
    label: str,
    curves: dict[str, SeedCurve],
) -> Drawing:
    sample = evidence.study.results("paper", model="hybrid")
    quantity = wear(sample[0])

    def draw(layout: Layout) -> Figure:
        figure, (axes,) = panels(layout, 3.4)
        for key, curve in curves.items():
            _band(axes, quantity.scaled(list(curve.x)), curve, key)
        axes.set_xlabel(quantity.label)
        axes.set_ylabel(label)
        axes.set_ylim(0, _top(curves.values()))
        legend(figure, [axes], layout)
        return figure

    alt = f"Curves over {quantity.label}: {label}, for {', '.join(look(n).label for n in curves)}."
    return Drawing(name, title, caption + _note(sample), alt, draw)


def _note(results: Iterable[RunResult]) -> str:
    seeds = len({r.case.seed for r in results})
    return f" Mean over {seeds} seeds, band: 95 % confidence interval." if seeds > 1 else ""


def _top(curves: Iterable[SeedCurve]) -> float:
    """Of an axis that shows all means, and of intervals that are wider than all means a part."""
    rows = list(curves)
    highest = max(float(c.mean.max()) for c in rows)
    return 1.05 * min(max(float(c.high.max()) for c in rows), ROOM * highest) or 1.0


def _band(axes: Axes, x: Row, curve: SeedCurve, key: str) -> None:
    """A curve with its confidence band, in the style of a model or detector."""
    style = look(key)
    axes.plot(x, curve.mean, **style.plot(marker=style.marker))
    axes.fill_between(x, curve.low, curve.high, color=style.color, alpha=0.18, lw=0)


def _least(model: str, detector: str, mme: SeedCurve, count: SeedCurve) -> str:
    best, title = int(np.argmin(mme.mean)), SWEPT[detector][0]
    return (
        f"{title[0].upper()}{title[1:]}, {model}: least MME "
        f"{mme.mean[best]:.2f} at {mme.x[best]:g} rad/s, with {count.mean[best]:.1f} adaptations; "
        f"over the range {mme.mean.min():.2f} to {mme.mean.max():.2f}."
    )
