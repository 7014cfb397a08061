"""What is measured anew on the page about speed, in its result files and on the page."""

from __future__ import annotations

import json

import pytest

from tests import page_table
from tests.benchmarks import kept, measured_table
from tests.benchmarks.kept import load, merge, table
from tests.benchmarks.measured_table import MeasuredTable
from tests.benchmarks.row import Row
from tests.page_table import with_table


def test_what_is_measured_anew_takes_its_row_s_place(monkeypatch):
    """Beside the same peer; another peer is another row, and the order stays."""
    monkeypatch.setattr(kept, "processor", lambda: "a processor")
    rows = load()
    first = rows[0]
    anew = Row(first["name"], 0.5, first["peer"], 2.0, "", "quiet")
    beside = Row(first["name"], 0.5, "somebody else", 1e-9, "")
    merged = merge(rows, [anew, beside])
    assert len(merged) == len(rows) + 1
    assert (merged[0]["ours_s"], merged[0]["processor"]) == (0.5, "a processor")
    assert merged[1:-1] == rows[1:]
    shown = table(merged)
    assert f"| {first['name']} | 500 ms | 2 s: {first['peer']} | 4 times faster | quiet; " in shown
    assert "| 1 ns: somebody else | 5.0e+08 times slower | " in shown


def test_a_table_is_kept_in_file_and_page(tmp_path, monkeypatch, capsys):
    """With day, commit and processor; the other tables stay, and it is printed as it grows."""
    file, page = tmp_path / "measured.json", tmp_path / "speed.md"
    file.write_text(json.dumps({"other": {"rows": []}}))
    page.write_text("before\n<!-- table fleet -->\nold\n<!-- end of table -->\nbehind\n")
    monkeypatch.setattr(kept, "processor", lambda: "a processor")
    monkeypatch.setattr(measured_table, "KEPT", file)
    monkeypatch.setattr(page_table, "path", lambda name: page)
    grown = MeasuredTable("fleet", "python -m tests.fleet", "machines", "time")
    grown.add(5, "3 s")
    assert capsys.readouterr().out.splitlines()[-1] == "| 5 | 3 s |"
    grown.keep()
    stored = json.loads(file.read_text())
    assert list(stored) == ["other", "fleet"]
    assert stored["fleet"]["rows"] == [["5", "3 s"]]
    said = page.read_text()
    assert said.startswith("before\n")
    assert said.endswith("<!-- end of table -->\nbehind\n")
    assert all(words in said for words in ("| 5 | 3 s |", stored["fleet"]["commit"], "a processor"))
    assert "old" not in said
    with pytest.raises(ValueError, match="no place"):
        with_table("a page", "a table", "fleet")
