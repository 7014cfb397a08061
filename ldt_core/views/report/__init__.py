"""The page of a run: one HTML file to look at, with plots that zoom, offline in any browser.

The plots are drawn by uPlot (`uplot/`, version 1.6.32, MIT licence, as its authors distribute it):
51 kB without dependencies, where plotly's basic bundle has 1.2 MB and bokeh's 1.4 MB of the 5 MB
that a page may have, and its series are typed arrays. Zoom, hover and legend by touch, keyboard and
screen reader are in `templates/group.js`, as uPlot has them for the mouse alone.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from ldt_core.views.page.page import Program, render
from ldt_core.views.report import sections
from ldt_core.views.report.data import data
from ldt_core.views.report.recorded_run import Run, read_run
from ldt_core.views.report.statistic import statistic

STYLES = ("uplot/uPlot.min.css", "templates/run.css")
LIBRARY = "uplot/uPlot.iife.min.js"
#: Parts of one script, in the order in which they build on each other.
PARTS = tuple(f"templates/{name}.js" for name in ("rows", "plot", "group", "page"))

__all__ = ["Run", "page", "read_run", "write_page"]


def write_page(recording: str | Path, out: str | Path, namespace: str = "") -> Run:
    """Write the page of a recorded run.

    Args:
        recording: of `ldt up`, `run` or `replay`.
        out: the HTML file; an old one is replaced.
        namespace: of the machine, when there are several.

    Raises:
        RecordingError: no recording of a run.
        ExperimentError, ModelError: a message in it that is no such record.
    """
    run = read_run(recording, namespace)
    Path(out).write_text(page(run), encoding="utf-8")
    return run


def page(run: Run) -> str:
    """The page as text."""
    compared = statistic([turn.signal for turn in run.turns])
    script = "".join(_own(name) for name in PARTS)
    program = Program(
        [_own(LIBRARY), f'"use strict";\n(() => {{\n{script}}})();\n'],
        "".join(_own(name) for name in STYLES),
        data(run, compared),
    )
    return render(
        sections.title(run),
        sections.lead(run),
        sections.FOOTER,
        sections.sections(run, compared),
        sections.answer(run),
        program,
    )


def _own(name: str) -> str:
    return (files("ldt_core.views.report") / name).read_text(encoding="utf-8")
