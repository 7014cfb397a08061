"""The page of a study: one HTML file that holds all, and its figures as files beside it."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import jinja2
from markupsafe import Markup

from ldt_core.study import sections
from ldt_core.study.blocks import Section
from ldt_core.study.figures import drawings, style
from ldt_core.study.figures.reading import Reading
from ldt_core.study.study import Study

FILE, FIGURES = "study.html", "figures"
TEMPLATES = "templates"


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
    found = drawings(Reading(study)).values()
    return [file for drawing in found if drawing for file in style.save(drawing, folder)]


def write_page(study: Study, out: Path | str) -> Path:
    """Write OUT/study.html, which needs no network and no other file.

    Returns:
        The file.

    Raises:
        LdtError: matplotlib is not installed.
    """
    style.require()
    reading = Reading(study)
    found = drawings(reading)
    made = [make(reading, found) for make in sections.SECTIONS]
    path = Path(out) / FILE
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(render(made, sections.lead(study), sections.footer(study)), encoding="utf-8")
    return path


def render(made: list[Section], lead: str, footer: str) -> str:
    """The page of these sections."""
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_template),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
    )
    # The two things that are not escaped are not the reader's or the machine's: our style sheet,
    # and drawings, whose texts matplotlib has escaped.
    environment.filters["own"] = Markup
    return environment.get_template("page.html").render(
        title="Study of the learning digital twin",
        lead=lead,
        footer=footer,
        sections=made,
        stylesheet=_template("style.css"),
    )


def _template(name: str) -> str:
    return (files("ldt_core.study") / TEMPLATES / name).read_text(encoding="utf-8")
