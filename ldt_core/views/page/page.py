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

from ldt_core.views.page.blocks import Answer, Section

TEMPLATES = "templates"


@dataclass(frozen=True)
class Program:
    """What a page does beside being read.

    Args:
        scripts: of our own or of a library, in the order in which they run.
        style: sheet for what they make.
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
) -> str:
    """The page of these sections, with the answer above them where there is one."""
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_template),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
    )
    # What is not escaped is not the reader's or the machine's: our style sheets and scripts,
    # drawings, whose texts matplotlib has escaped, and data, escaped here for where they stand.
    environment.filters["own"] = Markup
    return environment.get_template("page.html").render(
        title=title,
        lead=lead,
        footer=footer,
        sections=sections,
        answer=answer,
        stylesheet=_template("style.css"),
        program=program,
        data=escaped_json(program.data) if program else "",
        hashes=[_hash(script) for script in program.scripts] if program else [],
    )


def escaped_json(data: Any) -> str:
    """JSON that can stand in a script element: nothing in it can end the element.

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


def _template(name: str) -> str:
    return (files("ldt_core.views.page") / TEMPLATES / name).read_text(encoding="utf-8")
