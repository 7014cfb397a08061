"""What a diagnosis of many recordings shows at its end."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from ldt_core.cli.console import Console
from ldt_core.runs.each_recording import Answer

WIDTH = 110  # characters of a table in a file or pipe


def print_each(answers: Sequence[Answer], out: str | Path, as_json: bool) -> None:
    """All answers, on standard output.

    Args:
        answers: one for each recording.
        out: folder of all of them.
        as_json: one JSON list instead of the table.
    """
    if as_json:
        print(json.dumps([_plain(a) for a in answers], allow_nan=False, indent=1))
        return
    console = Console()
    if not console.is_terminal:
        console.width = WIDTH
    table = Table(title="verdicts")
    for column in ("recording", "verdict", "effects", "explains", "error, rad/s"):
        table.add_column(column, justify="right" if column == "explains" else "left")
    for a in answers:
        table.add_row(*(escape(cell) for cell in _row(a)))
    console.print(table)
    console.print(f"{out}: a folder for each", markup=False, highlight=False, soft_wrap=True)


def _row(a: Answer) -> list[str]:
    if a.found is None:
        return [a.recording, "failed", "", "", ""]
    verdict, gap = a.found["verdict"], a.found["gap"]
    effects = " and ".join(" or ".join(group) for group in verdict["acting"])
    closed = "" if gap["closed_fraction"] is None else f"{gap['closed_fraction']:.1%}"
    was, now = gap["before"]["rmse"], gap["after"]["rmse"]
    change = f"{was:.3g}" if was == now else f"{was:.3g} to {now:.3g}"
    return [a.recording, verdict["kind"], effects, closed, change]


def _plain(a: Answer) -> dict[str, Any]:
    return {
        "recording": a.recording,
        "out": str(a.folder),
        "error": a.error or None,
        "diagnosis": a.found,
    }
