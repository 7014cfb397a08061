"""The machine and the settings of a run, as far as its recording tells."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import PurePath

import msgs_config
from ldt_core.base.sentences import number, spoken
from ldt_core.base.settings import UNSET, as_options
from ldt_core.recording.run_settings import Setting
from ldt_core.views.page.blocks import Block, Folded, Pairs, Table, Text
from ldt_core.views.report.reported_run import ReportedRun
from ldt_core.views.step_view import DetectorStatistic

NOTHING = "-"
#: Settings that name files of the machine on which the run was.
PATHS = ("machine", "model", "detector", "cause", "effect", "play")


def blocks(run: ReportedRun, compared: DetectorStatistic) -> list[Block]:
    """Machine, experiments, model and detector."""
    extents, numbers = run.extents, [step.number for step in run.steps]
    begin, end = _moment(extents[0].start), _moment(extents[-1].end)
    pairs = [
        ("machine", run.bag.machine or "not recorded"),
        ("topics", run.bag.namespace or "of no namespace"),
        ("recording", f"{run.name}, from {begin} to {end}"),
        ("experiments", f"{len(numbers)}, numbers {numbers[0]} to {numbers[-1]}"),
        ("samples", f"{_span([e.length for e in extents])} in an experiment"),
        ("sample period", f"{_span([1e3 * e.period for e in extents])} ms"),
        ("duration", f"{_span([e.period * e.length for e in extents])} s"),
        ("voltage", f"{_outer([e.voltage for e in extents])} V"),
        ("speed", f"{_outer([e.speed for e in extents])} rad/s"),
        ("model", ", ".join(dict.fromkeys(m.kind for m in run.models)) or "not recorded"),
        ("detector", ", ".join(dict.fromkeys(s.detector for s in run.signals))),
        ("it compares", compared.label),
    ]
    limits = {"warning_limit": "warns above", "drift_limit": "is positive above"}
    for name, words in limits.items():
        values = [s.statistics[name] for s in run.signals if name in s.statistics]
        if values:
            pairs.append((words, f"{_span(values)} {compared.unit}".strip()))
    own = {n: v for n, v in run.signals[-1].statistics.items() if n not in limits}
    if own:
        text = ", ".join(f"{spoken(name)} {number(v)}" for name, v in own.items())
        pairs.append(("last statistics", text))
    parameters = run.models[0].parameters.get("machine") if run.models else None
    if isinstance(parameters, dict):
        told = ", ".join(f"{name}\u00a0=\u00a0{_value(v)}" for name, v in parameters.items())
        pairs.insert(1, ("as its file has it", f"{told} (SI units)"))
    kept = {name: _bare(name, value) for name, value in run.health.settings.items()}
    if not kept:
        return [Pairs(pairs), Text("The recording holds no settings of the run.", "missing")]
    pairs.append(("run with", as_options(kept) or "the defaults alone"))
    return [Pairs(pairs), Folded("All settings of the run", _table(kept))]


def _table(settings: Mapping[str, Setting]) -> Table:
    declared = msgs_config.parameters()
    rows = []
    for name, value in settings.items():
        words = _words(value)
        if words != NOTHING:
            words = f"{words} {declared.get(name, {}).get('unit', '')}".rstrip()
        rows.append((spoken(name), words, _default(name, value)))
    head = ("setting", "value", "default")
    return Table("What the run was started with", head, rows)


def _default(name: str, value: Setting) -> str:
    """What would hold today if it were not given."""
    declared = msgs_config.parameters().get(name)
    if declared is None:
        return "unknown to this version"
    return "the same" if value == declared["default"] else _words(declared["default"])


def _words(value: Setting) -> str:
    if value in UNSET:
        return NOTHING
    if isinstance(value, list):
        return ", ".join(value)
    return str(value).lower() if isinstance(value, bool) else _value(value)


def _bare(name: str, value: Setting) -> Setting:
    """Without where files lie, no business of those to whom the page is sent."""
    if name not in PATHS:
        return value
    if isinstance(value, list):
        return [PurePath(v).name for v in value]
    return PurePath(str(value)).name


def _value(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, int | float) else str(value)


def _moment(seconds: float) -> str:
    try:
        moment = datetime.fromtimestamp(seconds, UTC)
    except (OverflowError, ValueError, OSError):
        return f"{seconds:.0f} s"
    return f"{moment:%Y-%m-%d %H:%M:%S} UTC"


def _span(values: list[float]) -> str:
    low, high = f"{min(values):.4g}", f"{max(values):.4g}"
    return low if low == high else f"{low} to {high}"


def _outer(ranges: list[tuple[float, float]]) -> str:
    low, high = min(r[0] for r in ranges), max(r[1] for r in ranges)
    return f"{number(low)} to {number(high)}"
