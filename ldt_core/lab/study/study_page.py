"""The page of a study: one HTML file that holds all, and its figures as files beside it."""

from __future__ import annotations

from pathlib import Path

from ldt_core.lab.study import sections
from ldt_core.lab.study.evidence import Evidence
from ldt_core.lab.study.figures import drawings
from ldt_core.lab.study.study import Study
from ldt_core.views.page import style
from ldt_core.views.page.page_builder import render

TITLE = "Study of the learning digital twin"
FILE, FIGURES = "study.html", "figures"


def write_figures(study: Study, out: Path | str) -> list[Path]:
    """Write OUT/figures/NAME.png and NAME.svg of all figures that the study has runs for.

    Returns:
        The files.

    Raises:
        LdtError: matplotlib is not installed.
    """
    style.require()
    folder = Path(out) / FIGURES
    folder.mkdir(parents=True, exist_ok=True)
    found = drawings(Evidence(study)).values()
    return [file for drawing in found if drawing for file in style.save(drawing, folder)]


def write_page(study: Study, out: Path | str) -> Path:
    """Write OUT/study.html, which needs no network and no other file.

    Returns:
        The file.

    Raises:
        LdtError: matplotlib is not installed.
    """
    style.require()
    evidence = Evidence(study)
    found = drawings(evidence)
    made = [make(evidence, found) for make in sections.SECTIONS]
    path = Path(out) / FILE
    path.parent.mkdir(parents=True, exist_ok=True)
    page = render(TITLE, sections.lead(study), sections.footer(study), made)
    path.write_text(page, encoding="utf-8")
    return path
