"""The files that a browser gets: one page, its script, its sheet. They hold no data."""

from __future__ import annotations

from ldt_core.views.page.page_builder import (
    escaped_json,
    fill,
    one_script,
    plot_library,
    view_file,
)
from ldt_core.views.step_view import SCRIPT_WORDS, StepView

SHEETS = (
    "page/templates/style.css",
    "report/uplot/uPlot.min.css",
    "report/templates/run.css",
    "watch/templates/watch.css",
)
#: Parts of one script, in the order in which they build on each other.
PARTS = (
    *(f"report/templates/{name}.js" for name in ("rows", "plot", "group")),
    *(
        f"watch/templates/{name}.js"
        for name in ("light", "overview", "playback", "stream", "one", "live")
    ),
)
#: What the plots' script reads before anything has come.
EMPTY = {
    **{name: [] for name in StepView(0).row()},
    "statistic": {"label": "statistic", "value": [], "warning": [], "drift": []},
    **SCRIPT_WORDS,
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
    page = fill("watch/templates/watch.html", words=words, data=escaped_json(EMPTY))
    texts = {
        "/": ("text/html", page),
        "/watch.js": ("text/javascript", f"{plot_library()}\n{one_script(PARTS)}"),
        "/watch.css": ("text/css", "".join(view_file(sheet) for sheet in SHEETS)),
    }
    return {path: (kind, text.encode()) for path, (kind, text) in texts.items()}
