"""Printing to a terminal or a pipe, whatever stands in a text (`ldt_core.base.printable`)."""

from __future__ import annotations

import json
from typing import Any

import click

from ldt_core.base.printable import one_line, printable


def echo(message: Any = "", err: bool = False, nl: bool = True) -> None:
    """Print it to standard output, or to standard error."""
    click.echo(printable(str(message)), err=err, nl=nl)


def echo_json(record: Any, indent: int | None = None) -> None:
    """Print it as JSON to standard output; ValueError for a number that is not finite."""
    click.echo(json.dumps(record, allow_nan=False, indent=indent))


def echo_result(as_json: bool, record: Any, *lines: str) -> None:
    """Print what a command did, as JSON for programs or in lines for people."""
    if as_json:
        echo_json(record)
    else:
        echo("\n".join(lines))


def warn(*sentences: str) -> None:
    """Print sentences to standard error, a line each."""
    for sentence in sentences:
        echo(one_line(sentence), err=True)


__all__ = ["echo", "echo_json", "echo_result", "one_line", "printable", "warn"]
