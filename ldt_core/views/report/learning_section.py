"""What the adaptor did with the positives, and the models that came of it."""

from __future__ import annotations

from ldt_core.base.experiment import Action, ModelRecord, Signal
from ldt_core.base.sentences import number, ranges, spans, spoken
from ldt_core.views.page.blocks import Block, Folded, Mark, Table, Text
from ldt_core.views.report.reported_run import ReportedRun

#: Rows of a table that stands open; a longer one would bury what follows it.
OPEN_ROWS = 20
MARKS = {Action.ADAPTED: Mark("adapted", "good"), Action.REFUSED: Mark("refused", "open")}


def adaptations(run: ReportedRun) -> list[Block]:
    """One row for each positive."""
    rows = []
    for step in run.steps:
        done = step.adaptation
        if done is not None and done.action in MARKS:
            rows.append((f"Experiment {step.number}", MARKS[done.action], done.reason))
    if not rows:
        return [Text("No new model was tried in this run.", "missing")]
    head = ("after", "done", "why")
    return [_folded(Table("The adaptor at each positive", head, rows, cards=True))]


def models(run: ReportedRun) -> list[Block]:
    """One row for each model, with what it learned from and how it did."""
    if not run.models:
        return [Text("No model was recorded.", "missing")]
    by_version: dict[int, list[Signal]] = {}
    for signal in run.signals:
        by_version.setdefault(signal.model_version, []).append(signal)
    rows: list[tuple[str, ...]] = []
    for model in {m.version: m for m in run.models}.values():
        used = by_version.get(model.version, [])
        errors = [signal.max_error for signal in used]
        learned = "nothing" if not model.trained_on else ranges(spans(model.trained_on))
        mean = number(sum(errors) / len(errors)) if errors else "-"
        force = ranges(spans(signal.experiment for signal in used))
        rows.append((f"Version {model.version}", model.kind, learned, force, mean, _cause(model)))
    head: tuple[str, ...] = (
        "model",
        "kind",
        "learned from experiments",
        "in force in experiments",
        "mean error [rad/s]",
        "cause, in SI units",
    )
    if not any(row[-1] for row in rows):
        head, rows = head[:-1], [row[:-1] for row in rows]
    return [_folded(Table("The models", head, rows, numbers=(4,), cards=True, named=(2, 3)))]


def _folded(table: Table) -> Block:
    if len(table.rows) <= OPEN_ROWS:
        return table
    return Folded(f"{table.caption} ({len(table.rows)} rows)", table)


def _cause(model: ModelRecord) -> str:
    """Effect and amounts of a diagnosed model."""
    cause = model.parameters.get("cause")
    if not isinstance(cause, dict) or not isinstance(cause.get("parameters"), dict):
        return ""
    amounts = [
        f"{name}\u00a0=\u00a0{number(value, 4)}"
        for name, value in cause["parameters"].items()
        if isinstance(value, int | float)
    ]
    return f"{spoken(str(cause.get('effect', '')))}: {', '.join(amounts)}"
