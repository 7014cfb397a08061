"""The table of the page about speed is that of its result file."""

from __future__ import annotations

from ldt_core.docs import text
from tests.benchmarks.kept import load, merge, table
from tests.benchmarks.row import Row
from tests.page_table import with_table


def test_the_table_is_that_of_the_result_file():
    """As `python -m tests.benchmarks --keep` writes it."""
    assert with_table(text("speed"), table(load())) == text("speed")


def test_what_is_measured_anew_takes_its_row_s_place():
    """Beside the same peer; another peer is another row, and the order stays."""
    rows = load()
    first = rows[0]
    anew = Row(first["name"], 0.5, first["peer"], 2.0, "", "quiet")
    beside = Row(first["name"], 0.5, "somebody else", 1e-9, "")
    merged = merge(rows, [anew, beside], "a processor")
    assert len(merged) == len(rows) + 1
    assert (merged[0]["ours_s"], merged[0]["processor"]) == (0.5, "a processor")
    assert merged[1:-1] == rows[1:]
    shown = table(merged)
    assert f"| {first['name']} | 500 ms | {first['peer']} | 2 s | 4 |" in shown
    assert "| somebody else | 1 ns | 1/5e+08 |" in shown
