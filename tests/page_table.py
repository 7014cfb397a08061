"""The generated tables in the documentation's pages: where they stand, and how they get there."""

from __future__ import annotations

from ldt_core.docs import path

BEGIN, END = "<!-- table{} -->\n", "<!-- end of table -->\n"


def with_table(text: str, table: str, name: str = "") -> str:
    """A page's text with this table in its place; a page with several tells them by names."""
    begin = BEGIN.format(f" {name}" if name else "")
    before, found, rest = text.partition(begin)
    if not found:
        raise ValueError(f"there is no place {begin.strip()!r} for a table")
    return before + begin + "\n" + table + "\n" + END + rest.partition(END)[2]


def write_table(page: str, table: str, name: str = "") -> None:
    """Put a table into the page of this name."""
    file = path(page)
    file.write_text(with_table(file.read_text("utf-8"), table, name), "utf-8")
