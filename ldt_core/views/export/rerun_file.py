"""A recording as a file of Rerun: each quantity a curve over time, and a view that shows them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Signal
from ldt_core.views.export.predicted_runs import PredictedRun
from ldt_core.views.page import style

#: Curve → (entity, name in the key, colour).
CURVES = {
    "original_speed": ("speed/original", "original model", style.ORANGE),
    "predicted_speed": ("speed/predicted", "learning twin", style.SKY),
    "speed": ("speed/measured", "measured", style.INK),
    "voltage": ("voltage", "voltage", style.GREEN),
    "current": ("current", "current", style.PURPLE),
}
SIGNALS = {
    "max_error": ("error/largest", "largest error [rad/s]", style.BLUE),
    "adequacy": ("error/over_noise", "error over the noise", style.VERMILION),
    "model_version": ("model/version", "version of the model", style.GREY),
}
TIMELINE = "time"


def write_rerun(
    machine: str, runs: Iterable[PredictedRun], signals: Iterable[Signal], file: Path
) -> int:
    """Write the file; the number of samples.

    Args:
        machine: its name.
        runs: whose curves are drawn, on the timeline `time` [s since the epoch].
        signals: of these runs; their figures stand at the end of each experiment.

    Raises:
        LdtError: rerun-sdk is not installed.
    """
    try:
        import rerun as rr
        import rerun.blueprint as rrb
    except ImportError as error:
        raise LdtError(
            "Rerun's files need the library rerun-sdk, which is not installed: "
            "pip install 'ldt[rerun]'"
        ) from error

    stream = rr.RecordingStream(f"ldt {machine}".strip())
    stream.save(str(file))
    for entity, label, color in (*CURVES.values(), *SIGNALS.values()):
        look = rr.SeriesLines(names=label, colors=_rgb(color), widths=1.5)
        stream.log(entity, look, static=True)
    count, ends = 0, {}
    for run in runs:
        e = run.experiment
        ends[e.number] = e.end
        moments = rr.TimeColumn(TIMELINE, timestamp=e.start + e.time)
        for name, values in run.curves().items():
            if name in CURVES:
                scalars = rr.Scalars.columns(scalars=values)
                stream.send_columns(CURVES[name][0], [moments], scalars)
        count += len(e)
    rows = [s for s in signals if s.experiment in ends]
    for name, (entity, _, _) in SIGNALS.items():
        told = [(ends[s.experiment], getattr(s, name)) for s in rows]
        known = [(end, float(value)) for end, value in told if value is not None]
        if known:
            moments = rr.TimeColumn(TIMELINE, timestamp=np.array([end for end, _ in known]))
            scalars = rr.Scalars.columns(scalars=np.array([value for _, value in known]))
            stream.send_columns(entity, [moments], scalars)
    views = [
        rrb.TimeSeriesView(name="Speed [rad/s]", origin="/speed"),
        rrb.TimeSeriesView(name="Voltage [V]", origin="/voltage"),
        rrb.TimeSeriesView(name="Error of each experiment", origin="/error"),
    ]
    stream.send_blueprint(rrb.Blueprint(rrb.Vertical(*views)))
    stream.flush()
    stream.disconnect()
    return count


def _rgb(color: str) -> list[int]:
    return [int(color[i : i + 2], 16) for i in (1, 3, 5)]
