"""Printing to a terminal or a pipe, whatever stands in a text (`ldt_core.base.printable`)."""

from __future__ import annotations

from typing import Any

import click

from ldt_core.base.printable import one_line, printable


def echo(message: Any = "", err: bool = False, nl: bool = True) -> None:
    """Print it to standard output, or to standard error."""
    click.echo(printable(str(message)), err=err, nl=nl)


__all__ = ["echo", "one_line", "printable"]
