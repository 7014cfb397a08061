"""The figures of a study, a file a theme; `style.py` says how all of them look."""

from __future__ import annotations

from collections.abc import Callable

from ldt_core.lab.study.figures import (
    beyond,
    detectors,
    drifts,
    estimate,
    levels,
    models,
    stream,
    thresholds,
)
from ldt_core.lab.study.figures.reading import Reading
from ldt_core.views.page.style import Drawing

#: Name → what makes it; None where the study has no runs for it.
FIGURES: dict[str, Callable[[Reading], Drawing | None]] = {
    "input_output": stream.input_output,
    "staircase": stream.staircase,
    "sommerfeld": models.sommerfeld,
    "mme_by_level": levels.mme_by_level,
    "adaptations_by_level": levels.adaptations_by_level,
    "thresholds": thresholds.influence,
    "detectors": detectors.beside_chance,
    "shares": beyond.shares,
    "over_stream": beyond.over_stream,
    "estimate": estimate.over_stream,
    "detectable": drifts.detectable,
    "false_alarms": drifts.false_alarms,
    "kinds": drifts.kinds,
}


def drawings(reading: Reading) -> dict[str, Drawing | None]:
    """All figures, by name."""
    return {name: make(reading) for name, make in FIGURES.items()}
