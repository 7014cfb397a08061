"""What a score shows at its end."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from rich.box import SIMPLE
from rich.table import Table

from ldt_core.cli.console import Console
from ldt_core.lab.challenge.score.files import as_dict
from ldt_core.lab.challenge.score.markdown import cell, headline, quality, versus
from ldt_core.lab.challenge.score.score import Score

WIDTH = 110  # characters of a table in a file or pipe


def print_score(score: Score, files: Sequence[Path], as_json: bool) -> None:
    """What a score ends with, on standard output.

    Args:
        score: what came out.
        files: that were written.
        as_json: one JSON object instead of the tables.
    """
    if as_json:
        print(json.dumps(as_dict(score), allow_nan=False))
        return
    console = Console(soft_wrap=True)
    if not console.is_terminal:
        console.width = WIDTH
    table = Table("cases", "right is", "right", box=SIMPLE, title="the diagnosis, 95 % intervals")
    for words, what, estimate in headline(score):
        table.add_row(words, what, cell(estimate, "right"))
    console.print(table)
    table = Table("how good the answers are", "", box=SIMPLE)
    for figure, estimate in quality(score):
        table.add_row(figure, cell(estimate, figure))
    console.print(table)
    if len(score.judged) > 1:
        head, rows = versus(score)
        table = Table(*head, box=SIMPLE, title="side by side")
        for row in rows:
            table.add_row(*(part.partition(" of ")[0] for part in row))
        console.print(table)
    for note in score.notes:
        console.print(note, markup=False, highlight=False)
    listed = ", ".join(str(f) for f in files)
    console.print(listed, markup=False, highlight=False)
