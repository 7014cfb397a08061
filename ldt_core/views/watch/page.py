"""The files that a browser gets: one page, its script, its sheet. They hold no data."""

from __future__ import annotations

from importlib.resources import files

import jinja2
from markupsafe import Markup

from ldt_core.views.page.page import escaped_json

SHEETS = (
    ("page", "templates/style.css"),
    ("report", "uplot/uPlot.min.css"),
    ("report", "templates/run.css"),
    ("watch", "templates/watch.css"),
)
LIBRARY = ("report", "uplot/uPlot.iife.min.js")
#: Parts of one script, in the order in which they build on each other.
PARTS = (
    *(("report", f"templates/{name}.js") for name in ("rows", "plot", "group")),
    *(("watch", f"templates/{name}.js") for name in ("light", "overview", "one", "live")),
)
#: Parts of the page that a run's page has as well.
SHARED = ("course.html", "plots.html")
#: What the plots' script reads before anything has come.
EMPTY = {
    **{n: [] for n in ("number", "error", "original", "level", "version", "action", "reason")},
    "statistic": {"label": "statistic", "value": [], "warning": [], "drift": []},
    "worst": [],
    "models": {},
    "diagnoses": {},
    "samples": [],
}


def assets(words: str) -> dict[str, tuple[str, bytes]]:
    """Path → (content type, content).

    Args:
        words: what is watched, for the head of the page.
    """
    script = "".join(_own(*part) for part in PARTS)
    texts = {
        "/": ("text/html", _page(words)),
        "/watch.js": (
            "text/javascript",
            f'{_own(*LIBRARY)}\n"use strict";\n(() => {{\n{script}}})();\n',
        ),
        "/watch.css": ("text/css", "".join(_own(*sheet) for sheet in SHEETS)),
    }
    return {path: (kind, text.encode()) for path, (kind, text) in texts.items()}


def _page(words: str) -> str:
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_template),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
    )
    # Escaped for where it stands, in a script element.
    environment.filters["own"] = Markup
    page = environment.get_template("watch.html")
    return page.render(words=words, data=escaped_json(EMPTY))


def _template(name: str) -> str:
    return _own("report" if name in SHARED else "watch", f"templates/{name}")


def _own(package: str, name: str) -> str:
    return (files(f"ldt_core.views.{package}") / name).read_text(encoding="utf-8")
