"""A table of measurements without a peer: printed as it grows, and kept for its page with --keep.

What is kept is in `bags/measured.json`, with day, commit, processor and command.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tests.benchmarks.kept import stamp
from tests.page_table import write_table

KEPT = Path(__file__).parents[2] / "bags" / "measured.json"
PAGE = "speed"  # unless a table names another


class MeasuredTable:
    """A table that grows by a row as each is measured.

    Args:
        name: of the table's place in the page.
        command: that measures it.
        head: the columns.
        page: that it stands in.
    """

    def __init__(self, name: str, command: str, *head: str, page: str = PAGE) -> None:
        self.name = name
        self.kept: dict[str, Any] = {"page": page, "command": command, "head": head, "rows": []}
        print("\n".join(_head(head)), flush=True)

    def add(self, *cells: object) -> None:
        """A row; it is printed at once."""
        row = [str(cell) for cell in cells]
        assert len(row) == len(self.kept["head"]), row
        self.kept["rows"].append(row)
        print(_line(row), flush=True)

    def keep(self) -> None:
        """Into the file of results, and into the page."""
        tables = {**load(), self.name: {**self.kept, **stamp()}}
        KEPT.write_text(json.dumps(tables, indent=1, ensure_ascii=False) + "\n", "utf-8")
        write_table(self.kept["page"], shown(tables[self.name]), self.name)


def load() -> dict[str, Any]:
    """What is kept: name of the table → what it is made from."""
    tables: dict[str, Any] = json.loads(KEPT.read_text("utf-8"))
    return tables


def shown(kept: Mapping[str, Any]) -> str:
    """Markdown: the table, and where its figures are from."""
    rows = [_line(row) for row in kept["rows"]]
    told = f"By `{kept['command']}`, {kept['day']}, commit {kept['commit']}, {kept['processor']}."
    return "\n".join([*_head(kept["head"]), *rows, "", told, ""])


def _head(names: tuple[str, ...] | list[str]) -> list[str]:
    return [_line(names), "|---" * len(names) + "|"]


def _line(cells: tuple[str, ...] | list[str]) -> str:
    return f"| {' | '.join(cells)} |"
