"""Where original, linear and hybrid model part: the Sommerfeld region (paper, figure 6)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.errors import LdtError
from ldt_core.lab.study.figures.wear import wear
from ldt_core.lab.study.stream import in_region, intervals, region_rmse, speed_bands
from ldt_core.lab.study.study import Evidence
from ldt_core.lab.study.study_case import RunResult
from ldt_core.lab.study.study_plan import PAPER_MODELS
from ldt_core.machine.machine_file import load_machine
from ldt_core.views.page.style import SHADE, Drawing, Layout, legend, look, panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def sommerfeld(evidence: Evidence) -> Drawing | None:
    """The kept experiment that is longest in the region, measured and as three models predict it.

    None where no experiment was kept of both learning models under one detector.
    """
    by_detector: dict[str, dict[str, RunResult]] = {}
    for result in evidence.study.results("paper"):
        if result.kept:
            models = by_detector.setdefault(result.case.detector, {})
            models.setdefault(result.case.model, result)
    both = (m for m in by_detector.values() if set(PAPER_MODELS) <= set(m))
    shown = next(both, None)
    if shown is None:
        return None
    hybrid = shown["hybrid"]
    masks = {n: _region(hybrid, n) for n in sorted(set(hybrid.kept) & set(shown["linear"].kept))}
    number = max(masks, key=lambda n: int(masks[n].sum()))
    kept, mask = hybrid.kept[number], masks[number]
    rows = {"measured": kept["speed"], "original": kept["original"]}
    rows |= {name: shown[name].kept[number]["prediction"] for name in PAPER_MODELS}
    time = kept["time"]

    def draw(layout: Layout) -> Figure:
        figure, (axes,) = panels(layout, 3.2)
        for index, (begin, end) in enumerate(intervals(mask)):
            label = "Sommerfeld region" if index == 0 else None
            last = time[min(end, len(time) - 1)]
            axes.axvspan(time[begin], last, color=SHADE, lw=0, zorder=0, label=label)
        for name, row in rows.items():
            axes.plot(time, row, **look(name).plot(lw=2.4 if name == "measured" else 1.4))
        axes.set_ylabel("speed ω [rad/s]")
        axes.set_xlim(time[0], time[-1])
        axes.set_xlabel("time [s]")
        legend(figure, [axes], layout)
        return figure

    errors = []
    for name in ("original", *PAPER_MODELS):
        residual = np.subtract(rows[name], rows["measured"])
        inside, outside = (region_rmse(residual, m) or 0.0 for m in (mask, ~mask))
        errors.append(f"{name} {inside:.2f} and {outside:.2f}")
    worn = wear(hybrid).text(hybrid.truth[hybrid.number.index(number)])
    return Drawing(
        "sommerfeld",
        "Where the models part: the Sommerfeld region",
        f"Experiment {number} of seed {hybrid.case.seed}, {worn}, "
        f"{look(hybrid.case.detector).label} detector; of those kept it is longest in the region. "
        f"Root mean square error inside and outside of it [rad/s]: {', '.join(errors)}.",
        "Speed over time: measured, original, linear and hybrid model, the Sommerfeld region "
        "shaded.",
        draw,
    )


def _region(result: RunResult, number: int) -> NDArray[np.bool_]:
    """Samples of a kept experiment in the region; none for a machine that cannot be read."""
    kept = result.kept[number]
    try:
        machine = load_machine(result.case.machine)
    except LdtError:
        return np.zeros(len(kept["time"]), dtype=bool)
    where = speed_bands(machine, result.truth[result.number.index(number)])
    return in_region(kept["speed"], kept["time"][1] - kept["time"][0], where)
