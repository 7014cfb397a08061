"""Printing to a terminal or a pipe, whatever stands in a text (`ldt_core.base.printable`)."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Iterator
from typing import IO, Any

import click

from ldt_core.base.printable import one_line, printable

#: Where results go that are for programs; None for standard output.
_results: IO[str] | None = None


@contextlib.contextmanager
def results_alone(wanted: bool) -> Iterator[None]:
    """Nothing but JSON gets to standard output: what parts of the user's own print goes beside."""
    global _results
    if not wanted:
        yield
        return
    before, _results = _results, sys.stdout
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        _results = before


def echo(message: Any = "", err: bool = False, nl: bool = True) -> None:
    """Print it to standard output, or to standard error."""
    click.echo(printable(str(message)), err=err, nl=nl)


def echo_json(record: Any, indent: int | None = None) -> None:
    """Print it as JSON to standard output; ValueError for a number that is not finite."""
    echo_json_text(json.dumps(record, allow_nan=False, indent=indent) + "\n")


def echo_json_text(text: str) -> None:
    """Print what is JSON already."""
    click.echo(text, file=_results, nl=False)


def echo_result(as_json: bool, record: Any, *lines: str) -> None:
    """Print what a command did, as JSON for programs or in lines for people."""
    if as_json:
        echo_json(record)
    else:
        echo("\n".join(lines))


def echo_address(
    as_json: bool, shown: str, words: str, host: str, others: str, address: str
) -> None:
    """Say where something is served until Ctrl-C, and what others can do if the host lets them."""
    from ldt_core.views.watch.server import is_loopback

    if not is_loopback(host):
        warning = printable(f"WARNING: bound to {host}: everybody on this network can {others}")
        click.secho(warning, err=True, fg="red", bold=True)
    record = {"address": address, shown: words}
    echo_result(as_json, record, f"{words}: {address} (Ctrl-C ends it)")


def warn(*sentences: str) -> None:
    """Print sentences to standard error, a line each."""
    for sentence in sentences:
        echo(one_line(sentence), err=True)
