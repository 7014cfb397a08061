"""Standard streams that are closed, terminals without width, names that are no text."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from ldt_core.cli import invoke, ldt
from ldt_core.views.page.page_builder import plot_library

RUN = ["run", "--experiments", "1", "--model", "physics", "--no-bag"]


@pytest.mark.parametrize("closed", ["2>&-", "1>&-", "0<&-", "0<&- 1>&- 2>&-"])
def test_closed_streams_are_stood_in_for(closed):
    """The command does its work; what nobody hears is not said to a file in their place."""
    program = f"from ldt_core.cli import main; main({RUN!r})"
    shell = f'exec "$0" -c "{program}" {closed}'
    done = subprocess.run(
        ["sh", "-c", shell, sys.executable],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert ("1>" in closed) == ("experiments" not in done.stdout)


def test_a_terminal_of_five_columns_shows_the_figures(monkeypatch, capsys):
    """A table without room would be empty."""
    monkeypatch.setenv("COLUMNS", "5")
    assert invoke(ldt, RUN) == 0
    assert "new models" in capsys.readouterr().out


def test_a_recording_s_name_that_is_no_utf_8_is_refused(tmp_path, capsys):
    """Its metadata could not name its files."""
    name = os.fsdecode(b"x\xff")
    arguments = ["run", "--experiments", "1", "--model", "physics", "--bag", str(tmp_path / name)]
    assert invoke(ldt, arguments) == 2
    told = capsys.readouterr().err
    assert told.endswith("x\\udcff: expected a name in UTF-8, got other bytes\n")
    assert not list(tmp_path.iterdir())


def test_the_library_of_the_pages_comes_with_its_licence():
    """Whoever sends a page on sends it along."""
    text = plot_library()
    assert "The MIT License (MIT)" in text
    assert "THE SOFTWARE IS PROVIDED" in text
    assert text.index("*/") < text.index("uPlot (v")
