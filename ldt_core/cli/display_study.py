"""What a study shows at its end: the paper's Table 1 beside ours."""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import groupby
from pathlib import Path
from typing import Any

from rich.box import SIMPLE
from rich.table import Table

from ldt_core.cli.console import Console
from ldt_core.lab.study.study import Study
from ldt_core.lab.study.tables import summary, table_rows

WIDTH = 110  # characters of the table in a file or pipe
#: Column of the table → figure, its factor, digits and unit.
FIGURES = {
    "MME, rad/s": ("mme", 1, 2, ""),
    "of original": ("share", 100, 0, " %"),
    "adaptations": ("adaptations", 1, 1, ""),
    "precision": ("precision", 1, 2, ""),
    "recall": ("recall", 1, 2, ""),
}


def print_study(study: Study, page: Path, as_json: bool) -> None:
    """What a study ends with, on standard output.

    Args:
        study: what was run.
        page: where it is shown.
        as_json: one JSON object instead of the table.
    """
    rows = summary(study)
    if as_json:
        record = {"settings": study.settings, "runs": len(study.entries), "notes": study.notes}
        record |= {"missing": study.missing, "summary": rows, "table": table_rows(study)}
        print(json.dumps({**record, "page": str(page)}, allow_nan=False))
        return
    table = Table("model", "detector", box=SIMPLE, title="mean over seeds ± its 95 % interval")
    for name in FIGURES:
        table.add_column(name, justify="right")
    for (_, model), members in groupby(rows, key=lambda row: (row["group"], row["model"])):
        for row in members:
            table.add_row(model, row["detector"], *_cells(row))
        if row["paper"]:
            paper = {name: {"value": value} for name, value in row["paper"].items()}
            table.add_row(model, "in the paper", *_cells(paper), style="dim")
        table.add_section()
    console = Console(soft_wrap=True)
    if not console.is_terminal:
        console.width = WIDTH
    console.print(table)
    missing = [f"{study.missing} runs are missing"] if study.missing else []
    for note in (*missing, *study.notes):
        console.print(note, markup=False, highlight=False)
    console.print(f"page: {page}", markup=False, highlight=False)


def _cells(row: Mapping[str, Any]) -> list[str]:
    return [_text(row[n], scale, digits, unit) for n, scale, digits, unit in FIGURES.values()]


def _text(estimate: Mapping[str, Any], scale: float, digits: int, unit: str) -> str:
    """A mean, and half the width of its interval where it has one."""
    if (value := estimate["value"]) is None:
        return "-"
    low, high = estimate.get("low"), estimate.get("high")
    spread = ""
    if low is not None and high is not None:
        spread = f" ± {scale * (high - low) / 2:.{digits}f}"
    return f"{scale * value:.{digits}f}{spread}{unit}"
