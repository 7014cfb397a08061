"""Sections made into one HTML file that needs no network and no other file.

A page has no script, unless it is given a program; then those scripts run and no others.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import jinja2
from markupsafe import Markup

from ldt_core.views.page.blocks import Answer, Figure, Section


@dataclass(frozen=True)
class Program:
    """What a page does beside being read.

    Args:
        scripts: of our own or of a library, in the order in which they run.
        data: in JSON types; the scripts find it as text in the element `data`.
    """

    scripts: Sequence[str]
    style: str
    data: Any


def render(
    title: str,
    lead: str,
    footer: str,
    sections: Sequence[Section],
    answer: Answer | None = None,
    program: Program | None = None,
    figure: Figure | None = None,
) -> str:
    """The page of these sections, with the answer and its figure above them where there are."""
    return fill(
        "page/templates/page.html",
        title=title,
        lead=lead,
        footer=footer,
        sections=sections,
        answer=answer,
        figure_of_answer=figure,
        stylesheet=view_file("page/templates/style.css"),
        program=program,
        data=escaped_json(program.data) if program else "",
        hashes=[_hash(script) for script in program.scripts] if program else [],
    )


def fill(template: str, **values: object) -> str:
    """A template of the views, every value in it escaped unless it says `own`."""
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(view_file),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
    )
    # What is not escaped is not the reader's or the machine's: our style sheets and scripts,
    # drawings, whose texts matplotlib has escaped, and data, escaped by `escaped_json`.
    environment.filters["own"] = Markup
    return environment.get_template(template).render(**values)


def plot_library() -> str:
    """uPlot's script, with the licence that goes with every copy of it."""
    folder = "report/uplot"
    return f"/*\n{view_file(f'{folder}/LICENSE')}*/\n{view_file(f'{folder}/uPlot.iife.min.js')}"


def one_script(names: Sequence[str]) -> str:
    """Scripts by their places as one that leaves nothing behind in the page."""
    parts = "".join(view_file(name) for name in names)
    return f'"use strict";\n(() => {{\n{parts}}})();\n'


def view_file(name: str) -> str:
    """Text of a file by its place in `ldt_core/views`."""
    return (files("ldt_core.views") / name).read_text(encoding="utf-8")


def escaped_json(data: Any) -> str:
    r"""JSON that can stand in a script element: nothing in it can end the element.

    >>> escaped_json({"a": "</script><!--"})
    '{"a":"\\u003c/script\\u003e\\u003c!--"}'
    """
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return text


def _hash(script: str) -> str:
    """By which the page's policy knows the script, and runs no other."""
    digest = hashlib.sha256(script.encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"
