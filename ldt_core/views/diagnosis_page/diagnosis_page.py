"""The page of a diagnosis: one HTML file that needs no network, no script and no other file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from ldt_core.base.errors import LdtError
from ldt_core.base.result_files import write
from ldt_core.diagnosis.diagnosis import Diagnosis
from ldt_core.views.diagnosis_page import diagnosis_sections as sections
from ldt_core.views.diagnosis_page.gap_curves import gap_curves
from ldt_core.views.diagnosis_page.ranking import shares_bar
from ldt_core.views.diagnosis_page.time_curves import shown_free_runs
from ldt_core.views.page import style
from ldt_core.views.page.page_builder import render

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WHO = "a diagnosis' page"

JSON, PAGE = "diagnosis.json", "diagnosis.html"


def page(diagnosis: Diagnosis, kept: Path = Path(JSON)) -> str:
    """The page as text.

    Args:
        kept: the file for programs, as the page's commands name it.
    """
    style.require(WHO)
    further = (part for make in sections.SECTIONS if (part := make(diagnosis)))
    made = [sections.gap(diagnosis, kept), *further]
    return render(
        f"Gap diagnosis of {diagnosis.machine}",
        sections.lead(diagnosis),
        sections.FOOTER,
        made,
        sections.answer(diagnosis, kept),
        figure=sections.curves(diagnosis),
    )


def picture(diagnosis: Diagnosis, file: Path | str) -> None:
    """Draw before and after, where the gap lies, and the shares of a set, as one picture."""
    style.save_picture(diagnosis_figure(diagnosis), file)


def diagnosis_figure(diagnosis: Diagnosis) -> Figure:
    """The same as a figure."""
    panels = shown_free_runs(diagnosis), gap_curves(diagnosis), shares_bar(diagnosis)
    drawn = [p for p in panels if p is not None]
    if len(drawn) < 2:
        raise LdtError("nothing to draw: the diagnosis keeps no experiment")
    heights = [p.height(style.WIDE) for p in drawn]

    def draw(figure: Figure) -> None:
        parts = figure.subfigures(len(heights), 1, squeeze=False, height_ratios=heights).flat
        for part, p in zip(parts, drawn, strict=True):
            p.draw(part, style.WIDE)

    return style.picture(style.WIDE.width, sum(heights), draw, "a diagnosis' picture")


def as_json(diagnosis: Diagnosis) -> str:
    """The content of `diagnosis.json`."""
    return json.dumps(diagnosis.as_dict(), allow_nan=False, indent=1) + "\n"


def write_diagnosis(diagnosis: Diagnosis, folder: Path) -> None:
    """Write `diagnosis.json` and `diagnosis.html`."""
    write(folder / JSON, as_json(diagnosis))
    write(folder / PAGE, page(diagnosis, folder / JSON))
