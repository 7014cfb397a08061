"""The pages of `ldt docs`: they are found, and what they show works by copy and paste."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from pages import execute

from ldt_core import docs
from ldt_core.cli import invoke, ldt

REPOSITORY = Path(__file__).resolve().parents[2]
#: Blocks that cannot be run in a test, by page; each says why in a comment before it.
LEFT_OUT = {"deploy": 4}
#: Pages that start nodes.
ON_THE_BUS = ("connect",)


@pytest.mark.parametrize("name", docs.names())
def test_a_page_works_by_copy_and_paste(name, tmp_path, programs, request, monkeypatch):
    """Every block, in order, in an empty folder; what it prints is what the page says."""
    if name in ON_THE_BUS:
        pytest.importorskip("rclpy")
        request.getfixturevalue("domain")
    monkeypatch.setenv("COLUMNS", "200")
    done = execute(docs.text(name), tmp_path, programs)
    assert done.commands > 0
    assert len(done.left_out) == LEFT_OUT.get(name, 0), done.left_out


@pytest.mark.parametrize("name", docs.names())
def test_a_page_is_one_page(name):
    """A heading, and little enough to be read at one sitting; code counts."""
    assert docs.title(name)
    assert len(docs.text(name).splitlines()) <= 250


def test_the_readme_links_to_every_page():
    """A newcomer finds them without the command."""
    readme = (REPOSITORY / "README.md").read_text()
    assert [n for n in docs.names() if f"(ldt_core/docs/{n}.md)" not in readme] == []


def test_pages_are_listed_and_printed(capsys):
    """Names with titles; a page as its file has it; its path; the same as JSON."""
    assert invoke(ldt, ["docs"]) == 0
    listed = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
    assert listed == [[n, docs.title(n)] for n in docs.names()]
    assert invoke(ldt, ["docs", "connect"]) == 0
    assert capsys.readouterr().out == docs.text("connect")
    assert invoke(ldt, ["docs", "connect", "--path"]) == 0
    assert Path(capsys.readouterr().out.strip()).read_text() == docs.text("connect")
    assert invoke(ldt, ["docs", "--json"]) == 0
    assert [p["page"] for p in json.loads(capsys.readouterr().out)] == docs.names()


def test_a_slip_in_a_page_s_name_is_understood(capsys):
    """Exit code 2 and the nearest name."""
    assert invoke(ldt, ["docs", "conect"]) == 2
    assert "did you mean 'connect'?" in capsys.readouterr().err
