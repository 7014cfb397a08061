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
from ldt_core.views.report.recorded_run import Run
from ldt_core.views.report.statistic import Statistic

NOTHING = "-"
#: Settings that name files of the machine on which the run was.
PATHS = ("machine", "model", "detector", "cause", "effect", "play")


def blocks(run: Run, compared: Statistic) -> list[Block]:
    """Machine, experiments, model and detector."""
    turns = run.turns
    signal = turns[-1].signal
    pairs = [
        ("machine", run.bag.machine or "not recorded"),
        ("topics", run.bag.namespace or "of no namespace"),
        ("recording", f"{run.name}, from {_moment(turns[0].start)} to {_moment(turns[-1].end)}"),
        ("experiments", f"{len(turns)}, numbers {turns[0].experiment} to {turns[-1].experiment}"),
        ("samples", f"{_span([t.length for t in turns])} in an experiment"),
        ("sample period", f"{_span([1e3 * t.period for t in turns])} ms"),
        ("duration", f"{_span([t.period * t.length for t in turns])} s"),
        ("voltage", f"{_outer([t.voltage for t in turns])} V"),
        ("speed", f"{_outer([t.speed for t in turns])} rad/s"),
        ("model", ", ".join(dict.fromkeys(m.kind for m in run.models)) or "not recorded"),
        ("detector", ", ".join(dict.fromkeys(t.signal.detector for t in turns))),
        ("it compares", compared.label),
    ]
    limits = {"warning_limit": "warns above", "drift_limit": "is positive above"}
    for name, words in limits.items():
        values = [t.signal.statistics[name] for t in turns if name in t.signal.statistics]
        if values:
            pairs.append((words, f"{_span(values)} {compared.unit}".strip()))
    own = {n: v for n, v in signal.statistics.items() if n not in limits}
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
