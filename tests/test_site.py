"""The documentation site: whole, from pages and code alone, with nothing from elsewhere."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

import pytest

import ldt_core
import msgs_config
from ldt_core import docs
from ldt_core.base.settings import flag_of
from ldt_core.cli import SECTIONS

REPOSITORY = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(REPOSITORY / "docs"))

import notebooks  # noqa: E402
import site_pages  # noqa: E402

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """Built once."""
    pytest.importorskip("material")
    import build_site

    folder = tmp_path_factory.mktemp("site") / "site"
    assert build_site.build(folder) == []
    return folder


def test_the_site_has_every_page_and_loads_nothing_from_elsewhere(site):
    """Pages of `ldt docs`, notebooks and the reference; links were checked as it was built."""
    pages = {file.stem for file in site.glob("*.html")}
    assert set(docs.names()) | set(notebooks.names()) | {"commands", "api", "index"} <= pages
    assert (site / "figures" / "rotor_run.png").exists()
    assert list((site / "notebook_figures").glob("*.png"))


def test_the_search_finds_from_the_disk(site):
    """A browser allows a page from the disk neither a worker nor a request, which it needs."""
    driver = pytest.importorskip("playwright.sync_api")
    program = next((b for b in map(shutil.which, BROWSERS) if b), None)
    if program is None:
        pytest.skip("no Chromium is installed")
    with driver.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=program, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto((site / "index.html").as_uri())
        page.click(".md-search__input")
        page.keyboard.type("unbalance")
        page.wait_for_selector(".md-search-result__item")
        browser.close()


def test_the_reference_has_every_command_parameter_topic_and_name(site):
    """As the code declares them."""
    text = {name: (site / f"{name}.html").read_text() for name in ("commands", "api", "topics")}
    for names in SECTIONS.values():
        for name in names:
            assert f">ldt {name}" in text["commands"], name
    for name in ldt_core.__all__:
        assert f">ldt.{name}" in text["api"], name
    for topic in msgs_config.topics():
        assert f"<code>{topic}</code>" in text["topics"], topic
    parameters = (site / "parameters.html").read_text()
    for name in msgs_config.parameters():
        assert f"<code>{flag_of(name)}</code>" in parameters, name


def test_a_broken_link_and_a_foreign_address_are_found(site):
    """So the build would end."""
    import build_site

    page = site / "broken.html"
    page.write_text('<a href="nowhere.html">x</a><script src="https://cdn.example/x.js"></script>')
    assert build_site.faults(page, site) == [
        "broken.html loads https://cdn.example/x.js",
        "broken.html links to nowhere.html, which is not there",
    ]
    page.unlink()


def test_every_page_stands_once_in_the_navigation():
    """Where a reader looks for it."""
    placed = [name for names in site_pages.NAV.values() for name in names]
    assert len(placed) == len(set(placed))
    assert set(docs.names()) <= set(placed)


def test_the_site_is_written_as_the_house_is():
    """The glossary's terms are in their order, each once."""
    rows = re.findall(r"^\| \*(.+?)\* \|", (REPOSITORY / "docs" / "glossary.md").read_text(), re.M)
    assert rows == sorted(set(rows), key=str.casefold)
    assert len(rows) > 15


@pytest.mark.parametrize("name", notebooks.names())
def test_a_notebook_prints_what_it_shows(name):
    """Word for word, and each number within a tenth; it draws as many pictures."""
    stored = notebooks.read(name)
    again = notebooks.executed(notebooks.read(name))
    for before, now in zip(notebooks.printed(stored), notebooks.printed(again), strict=True):
        assert NUMBER.sub("#", before) == NUMBER.sub("#", now)
        shown, found = ([float(n) for n in NUMBER.findall(t)] for t in (before, now))
        assert found == pytest.approx(shown, rel=0.1, abs=0.05)
    kinds = [
        [[out["output_type"] for out in cell["outputs"]] for cell in notebooks.code_cells(book)]
        for book in (stored, again)
    ]
    assert kinds[0] == kinds[1]
