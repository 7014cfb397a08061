"""Where original, linear and hybrid model part: the Sommerfeld region (paper, figure 6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.errors import LdtError
from ldt_core.lab.study.evidence import Evidence
from ldt_core.lab.study.figures.wear import wear
from ldt_core.lab.study.region import in_region, intervals, speed_bands
from ldt_core.lab.study.study import Study
from ldt_core.lab.study.study_case import RunResult
from ldt_core.machine.machine_file import load_machine
from ldt_core.views.page.style import SHADE, Drawing, Layout, legend, look, panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARGIN = 1.0  # s round the stretch that the lower panel enlarges


@dataclass(frozen=True)
class RegionExperiment:
    """One experiment as several models predicted it."""

    number: int
    results: dict[str, RunResult]
    time: NDArray[np.float64]
    rows: dict[str, NDArray[np.float64]]
    mask: NDArray[np.bool_]

    def rmse(self, name: str, inside: bool = True) -> float:
        """Of a model inside or outside the region; 0 where the experiment has no such part."""
        mask = self.mask if inside else ~self.mask
        square = (self.rows["measured"] - self.rows[name])[mask] ** 2
        return float(np.sqrt(square.mean())) if mask.any() else 0.0

    @property
    def contrast(self) -> float:
        """How much more the linear model's error grows in the region than the hybrid one's."""
        linear, hybrid = (
            self.rmse(name) - self.rmse(name, inside=False) for name in ("linear", "hybrid")
        )
        return linear - hybrid


def sommerfeld(evidence: Evidence) -> Drawing | None:
    """One experiment, measured and as the three models predict it.

    Of the experiments kept of both that touch the region, the one with the greatest
    `RegionExperiment.contrast`. None where no experiment was kept of both.
    """
    study = evidence.study
    candidates = _candidates(study)
    candidates = [c for c in candidates if c.mask.any()] or candidates
    if not candidates:
        return None
    shown = max(candidates, key=lambda s: s.contrast)
    hybrid = shown.results["hybrid"]
    worn = wear(hybrid).text(hybrid.truth[hybrid.number.index(shown.number)])
    spans = intervals(shown.mask)

    def draw(layout: Layout) -> Figure:
        figure, axes = panels(layout, 2.9 if spans else 3.2, count=2 if spans else 1)
        for one in axes:
            _curves(one, shown, spans)
            one.set_ylabel("speed ω [rad/s]")
        axes[0].set_xlim(shown.time[0], shown.time[-1])
        axes[-1].set_xlabel("time [s]")
        if spans:
            begin, end = _enlarged(shown, spans)
            axes[1].set_xlim(begin, end)
            seen = (shown.time >= begin) & (shown.time <= end)
            values = np.concatenate([row[seen] for row in shown.rows.values()])
            axes[1].set_ylim(values.min() - 1, values.max() + 1)
            axes[1].set_title(f"enlarged, {begin:.0f} to {end:.0f} s")
        legend(figure, axes[:1], layout)
        return figure

    errors = ", ".join(
        f"{n} {shown.rmse(n):.2f} and {shown.rmse(n, inside=False):.2f}"
        for n in ("original", "linear", "hybrid")
    )
    return Drawing(
        "sommerfeld",
        "Where the models part: the Sommerfeld region",
        f"Experiment {shown.number} of seed {hybrid.case.seed}, {worn}, "
        f"{look(hybrid.case.detector).label} detector. Root mean square error inside "
        f"and outside the region [rad/s]: {errors}. Of the {len(candidates)} experiments kept "
        "that touch the region it is the one in which the linear model's error grows most there "
        f"against the hybrid one's; {_typical(study)}",
        "Speed over time: measured, original, linear and hybrid model, the Sommerfeld region "
        "shaded, and the stretch in which they differ most once more, enlarged.",
        draw,
    )


def _candidates(study: Study) -> list[RegionExperiment]:
    """The experiments kept of both models, under the first detector of the plan that has some."""
    pairs: dict[str, dict[int, dict[str, RunResult]]] = {}
    for result in study.results("paper"):
        case = result.case
        pairs.setdefault(case.detector, {}).setdefault(case.seed, {})[case.model] = result
    for by_seed in pairs.values():
        found = []
        for models in by_seed.values():
            if {"linear", "hybrid"} <= set(models):
                both = set(models["linear"].kept) & set(models["hybrid"].kept)
                found += [_shown(models, number) for number in sorted(both)]
        if found:
            return found
    return []


def _shown(models: dict[str, RunResult], number: int) -> RegionExperiment:
    kept = {name: models[name].kept[number] for name in ("linear", "hybrid")}
    rows = {"measured": kept["hybrid"]["speed"], "original": kept["hybrid"]["original"]}
    rows |= {name: kept[name]["prediction"] for name in kept}
    arrays = {name: np.array(row) for name, row in rows.items()}
    time = np.array(kept["hybrid"]["time"])
    case = models["hybrid"].case
    truth = models["hybrid"].truth[models["hybrid"].number.index(number)]
    try:
        where = speed_bands(load_machine(case.machine), truth)
    except LdtError:
        where = []
    mask = in_region(arrays["measured"], float(time[1] - time[0]), where)
    return RegionExperiment(number, models, time, arrays, mask)


def _curves(axes: Axes, shown: RegionExperiment, spans: list[tuple[int, int]]) -> None:
    for index, (begin, end) in enumerate(spans):
        label = "Sommerfeld region" if index == 0 else None
        last = shown.time[min(end, len(shown.time) - 1)]
        axes.axvspan(shown.time[begin], last, color=SHADE, lw=0, zorder=0, label=label)
    for name in ("measured", "original", "linear", "hybrid"):
        width = 2.4 if name == "measured" else 1.4
        axes.plot(shown.time, shown.rows[name], **look(name).plot(lw=width))


def _enlarged(shown: RegionExperiment, spans: list[tuple[int, int]]) -> tuple[float, float]:
    """The stretch [s] of the region in which linear and hybrid differ most, with a margin."""
    apart = np.abs(shown.rows["linear"] - shown.rows["hybrid"])
    begin, end = max(spans, key=lambda s: apart[s[0] : s[1]].max())
    last = min(end, len(shown.time) - 1)
    low = max(shown.time[0], shown.time[begin] - MARGIN)
    return float(low), float(min(shown.time[-1], shown.time[last] + MARGIN))


def _typical(study: Study) -> str:
    medians = {}
    for model in ("linear", "hybrid"):
        results = study.results("paper", model=model)
        inside = [v for r in results for v in r.region_rmse if v is not None]
        if not inside:
            return "no experiment of the study touches the region."
        medians[model] = float(np.median(inside))
    return (
        f"over all experiments that touch the region the median is {medians['linear']:.2f} "
        f"(linear) and {medians['hybrid']:.2f} (hybrid)."
    )
