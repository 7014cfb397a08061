"""What the page's script draws, in JSON types."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ldt_core.views.report.recorded_run import Run, Turn
from ldt_core.views.report.samples import Packed
from ldt_core.views.report.statistic import Statistic

DIGITS = 6  # of figures that are drawn; a screen shows four


def data(run: Run, compared: Statistic) -> dict[str, Any]:
    """Figures of all experiments by column, samples by experiment, and who learned from what."""

    def column(value: Callable[[Turn], Any]) -> list[Any]:
        return [value(turn) for turn in run.turns]

    return {
        "number": column(lambda t: t.experiment),
        "error": _rounded(column(lambda t: t.signal.max_error)),
        "original": _rounded(column(lambda t: t.original)),
        "level": column(lambda t: int(t.signal.level)),
        "version": column(lambda t: t.signal.model_version),
        "action": column(lambda t: str(t.adaptation.action) if t.adaptation else ""),
        "reason": column(lambda t: t.adaptation.reason if t.adaptation else ""),
        "statistic": {
            "label": compared.label,
            "value": _rounded(compared.values),
            "warning": _rounded(compared.warning),
            "drift": _rounded(compared.drift),
        },
        "worst": run.worst_first,
        "models": {
            str(m.version): {"kind": m.kind, "learned": list(m.trained_on)} for m in run.models
        },
        "diagnoses": {str(d.experiment): d.sentence for d in run.diagnoses},
        "samples": [_samples(turn.samples) for turn in run.turns],
    }


def _samples(packed: Packed | None) -> dict[str, Any] | None:
    if packed is None:
        return None
    return {
        "channels": [[c.name, c.low, c.step] for c in packed.channels],
        "data": packed.data,
        "of": packed.of,
    }


def _rounded(values: list[float | None]) -> list[float | None]:
    return [None if v is None or not math.isfinite(v) else float(f"{v:.{DIGITS}g}") for v in values]
