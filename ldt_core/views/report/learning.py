"""What the adaptor did with the positives, and the models that came of it."""

from __future__ import annotations

from ldt_core.base.experiment import Action, ModelRecord
from ldt_core.base.sentences import number, ranges, spans, spoken
from ldt_core.views.page.blocks import Block, Folded, Mark, Table, Text
from ldt_core.views.report.recorded_run import Run, Turn

#: Rows of a table that stands open; a longer one would bury what follows it.
OPEN = 20
MARKS = {Action.ADAPTED: Mark("adapted", "good"), Action.REFUSED: Mark("refused", "open")}


def adaptations(run: Run) -> list[Block]:
    """One row for each positive."""
    rows = []
    for turn in run.turns:
        done = turn.adaptation
        if done is not None and done.action in MARKS:
            rows.append((f"Experiment {turn.experiment}", MARKS[done.action], done.reason))
    if not rows:
        return [Text("No new model was tried in this run.", "missing")]
    head = ("after", "done", "why")
    return [_folded(Table("The adaptor at each positive", head, rows, cards=True))]


def models(run: Run) -> list[Block]:
    """One row for each model, with what it learned from and how it did."""
    if not run.models:
        return [Text("No model was recorded.", "missing")]
    by_version: dict[int, list[Turn]] = {}
    for turn in run.turns:
        by_version.setdefault(turn.signal.model_version, []).append(turn)
    rows: list[tuple[str, ...]] = []
    for model in {m.version: m for m in run.models}.values():
        used = by_version.get(model.version, [])
        errors = [turn.signal.max_error for turn in used]
        learned = "nothing" if not model.trained_on else ranges(spans(model.trained_on))
        mean = number(sum(errors) / len(errors)) if errors else "-"
        force = ranges(spans(turn.experiment for turn in used))
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
    if len(table.rows) <= OPEN:
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
