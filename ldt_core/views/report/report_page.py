"""The page of a run: one HTML file to look at, with plots that zoom, offline in any browser.

The plots are drawn by uPlot (`uplot/`, version 1.6.32, MIT licence, as its authors distribute it):
51 kB without dependencies, where plotly's basic bundle has 1.2 MB and bokeh's 1.4 MB of the 5 MB
that a page may have, and its series are typed arrays. Zoom, hover and legend by touch, keyboard and
screen reader are in `templates/group.js`, as uPlot has them for the mouse alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ldt_core.base.result_files import write
from ldt_core.views.page.page_builder import Program, one_script, plot_library, render, view_file
from ldt_core.views.report import report_sections
from ldt_core.views.report.reported_run import ReportedRun, read_run
from ldt_core.views.step_view import SCRIPT_WORDS, DetectorStatistic, drawn_number, statistic

STYLES = ("report/uplot/uPlot.min.css", "report/templates/run.css")
#: Parts of one script, in the order in which they build on each other.
PARTS = tuple(f"report/templates/{name}.js" for name in ("rows", "plot", "group", "page"))

__all__ = ["ReportedRun", "page", "read_run", "write_run_page"]


def write_run_page(recording: str | Path, out: str | Path, namespace: str = "") -> ReportedRun:
    """Write the page of a recorded run."""
    run = read_run(recording, namespace)
    write(Path(out), page(run))
    return run


def page(run: ReportedRun) -> str:
    """The page as text."""
    compared = statistic(run.signals)
    program = Program(
        [plot_library(), one_script(PARTS)],
        "".join(view_file(name) for name in STYLES),
        plotted_data(run, compared),
    )
    return render(
        f"Run of {run.bag.machine or 'an unnamed machine'}: {run.name}",
        report_sections.lead(run),
        report_sections.FOOTER,
        report_sections.sections(run, compared),
        report_sections.answer(run),
        program,
    )


def plotted_data(run: ReportedRun, compared: DetectorStatistic) -> dict[str, Any]:
    """Figures of all experiments by column, samples by experiment, and who learned from what."""
    columns: dict[str, list[Any]] = {name: [] for name in run.steps[0].row()}
    for step in run.steps:
        for name, value in step.row().items():
            columns[name].append(value)
    return {
        **columns,
        "statistic": {
            "label": compared.label,
            "value": [drawn_number(v) for v in compared.values],
            "warning": [drawn_number(v) for v in compared.warning],
            "drift": [drawn_number(v) for v in compared.drift],
        },
        **SCRIPT_WORDS,
        "worst": run.worst_first,
        "models": {
            str(m.version): {"kind": m.kind, "learned": list(m.trained_on)} for m in run.models
        },
        "diagnoses": {str(d.experiment): d.sentence for d in run.diagnoses},
        "samples": [step.packed and step.packed.as_dict() for step in run.steps],
    }
