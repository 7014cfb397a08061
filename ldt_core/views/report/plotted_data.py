"""What the page's script draws, in JSON types."""

from __future__ import annotations

from typing import Any

from ldt_core.views.detector_statistic import DetectorStatistic
from ldt_core.views.packed_samples import PackedSamples
from ldt_core.views.report.reported_run import ReportedRun
from ldt_core.views.step_view import rounded


def plotted_data(run: ReportedRun, compared: DetectorStatistic) -> dict[str, Any]:
    """Figures of all experiments by column, samples by experiment, and who learned from what."""
    rows = [step.row() for step in run.steps]
    return {
        **{name: [row[name] for row in rows] for name in rows[0]},
        "statistic": {
            "label": compared.label,
            "value": [rounded(v) for v in compared.values],
            "warning": [rounded(v) for v in compared.warning],
            "drift": [rounded(v) for v in compared.drift],
        },
        "worst": run.worst_first,
        "models": {
            str(m.version): {"kind": m.kind, "learned": list(m.trained_on)} for m in run.models
        },
        "diagnoses": {str(d.experiment): d.sentence for d in run.diagnoses},
        "samples": [_samples(step.packed) for step in run.steps],
    }


def _samples(packed: PackedSamples | None) -> dict[str, Any] | None:
    if packed is None:
        return None
    return {
        "channels": [[c.name, c.low, c.step] for c in packed.channels],
        "data": packed.data,
        "of": packed.of,
    }
