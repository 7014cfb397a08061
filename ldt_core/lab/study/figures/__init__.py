"""The figures of a study; `views.page.style` says how all of them look."""

from __future__ import annotations

from collections.abc import Callable

from ldt_core.lab.study.figures import curve_figures, dot_figures, stream_figures
from ldt_core.lab.study.figures.region_figure import sommerfeld
from ldt_core.lab.study.figures.robustness_figure import robustness
from ldt_core.lab.study.study import Evidence
from ldt_core.views.page.style import Drawing

#: Name → what makes it; None where the study has no runs for it.
FIGURES: dict[str, Callable[[Evidence], Drawing | None]] = {
    "input_output": stream_figures.input_output,
    "staircase": stream_figures.staircase,
    "sommerfeld": sommerfeld,
    "mme_by_level": curve_figures.mme_by_level,
    "adaptations_by_level": curve_figures.adaptations_by_level,
    "thresholds": curve_figures.thresholds,
    "shares": dot_figures.shares,
    "over_stream": stream_figures.over_stream,
    "detectable": stream_figures.detectable,
    "false_alarms": dot_figures.false_alarms,
    "robust_streams": robustness,
}


def drawings(evidence: Evidence) -> dict[str, Drawing | None]:
    """All figures, by name."""
    return {name: make(evidence) for name, make in FIGURES.items()}
