"""The pages of `ldt docs`: they are found, and what they show works by copy and paste."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from pages import execute

import msgs_config
from ldt_core import docs
from ldt_core.cli import invoke, ldt

REPOSITORY = Path(__file__).resolve().parents[2]
#: Blocks that cannot be run in a test, by page; each says why in a comment before it.
LEFT_OUT = {
    **{"connect": 1, "deploy": 2, "detector": 1, "network": 2, "diagnosis": 1, "paper": 2},
    **{"effect": 3, "real": 4, "speed": 1, "start": 1, "streams": 1, "watch": 2},
}
#: Pages that start nodes.
ON_THE_BUS = ("connect", "promises", "start")


@pytest.mark.usefixtures("one_core")  # other tests ask for two processes of what has them
@pytest.mark.parametrize("name", docs.names())
def test_a_page_works_by_copy_and_paste(name, tmp_path, programs, request, monkeypatch):
    """Every block, in order, in an empty folder; what it prints is what the page says."""
    # The README begins with the same demo, and its test looks at the page.
    request.getfixturevalue("in_one_layout" if "ldt demo\n" in docs.text(name) else "undrawn")
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


def test_the_readme_works_by_copy_and_paste(tmp_path, programs, monkeypatch, capsys):
    """All but the two set-up commands, of which one runs this, and the environment's activation.

    The page is there; what the demo proposes works; it does not replace what it made.
    """
    monkeypatch.setenv("COLUMNS", "200")
    done = execute((REPOSITORY / "README.md").read_text(), tmp_path, programs)
    assert (done.commands, len(done.left_out)) == (1, 4)
    monkeypatch.chdir(tmp_path)
    assert Path("ldt_demo/run.html").stat().st_size > 100_000
    assert invoke(ldt, ["advise", "ldt_demo/run"]) == 0
    assert "Do not hold" in capsys.readouterr().out
    assert invoke(ldt, ["demo"]) == 2
    assert "a folder that does not exist yet (or --force)" in capsys.readouterr().err


def test_the_readme_is_short_and_its_links_lead_somewhere():
    """At most 150 lines; every file that it or a page names is there, pictures included."""
    readme = REPOSITORY / "README.md"
    assert len(readme.read_text().splitlines()) <= 150
    lost = [
        f"{page.name}: {link}"
        for page in (readme, *map(docs.path, docs.names()))
        for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text())
        if not (page.parent / link).exists()
    ]
    assert lost == []


def test_the_readme_links_to_every_page():
    """A newcomer finds them without the command."""
    readme = (REPOSITORY / "README.md").read_text()
    assert [n for n in docs.names() if f"(ldt_core/docs/{n}.md)" not in readme] == []


def test_the_tests_that_a_page_names_are_there():
    """A promise is worth what its command shows: `-k` selects something, in files that exist."""
    commands = [
        command
        for name in docs.names()
        for command in re.findall(r"`((?:pytest|python -m) tests[^`]+)`", docs.text(name))
    ]
    assert len(commands) > 40
    for command in commands:
        _, *words = shlex.split(command)
        if words[0] == "-m":
            assert (REPOSITORY / words[1].replace(".", "/")).with_suffix(".py").exists(), command
            continue
        files = [REPOSITORY / word for word in words if word.startswith("tests/")]
        found = [n for f in files for n in re.findall(r"^def (test_\w+)", f.read_text(), re.M)]
        wanted = words[words.index("-k") + 1].split(" or ") if "-k" in words else [""]
        assert [w for w in wanted if not any(w in n for n in found)] == [], command


def test_the_defaults_of_their_page_are_those_that_hold():
    """Each option of its table, with the value that `parameters.yaml` declares."""
    rows = re.findall(r"^\| `--([\w-]+)` \| `?([^`|]+?)`? \|", docs.text("defaults"), re.MULTILINE)
    declared = {n.replace("_", "-"): d["default"] for n, d in msgs_config.parameters().items()}
    assert len(rows) > 10
    for name, shown in rows:
        value = declared[name]
        told = {True: "on", False: "off"}[value] if isinstance(value, bool) else value
        assert shown == (f"{told:g}" if isinstance(told, float) else str(told)), name


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
