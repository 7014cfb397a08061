"""Sections made into one HTML file that needs no network, no script and no other file."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files

import jinja2
from markupsafe import Markup

from ldt_core.report.blocks import Answer, Section

TEMPLATES = "templates"


def render(
    title: str, lead: str, footer: str, sections: Sequence[Section], answer: Answer | None = None
) -> str:
    """The page of these sections, with the answer above them where there is one."""
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
        title=title,
        lead=lead,
        footer=footer,
        sections=sections,
        answer=answer,
        stylesheet=_template("style.css"),
    )


def _template(name: str) -> str:
    return (files("ldt_core.report") / TEMPLATES / name).read_text(encoding="utf-8")
