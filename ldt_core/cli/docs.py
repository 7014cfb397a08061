"""`ldt docs`: the pages that say how to do one thing each."""

from __future__ import annotations

import sys

import click

from ldt_core.cli.completion import known
from ldt_core.cli.options import json_option
from ldt_core.cli.terminal import echo_json


@click.command("docs", short_help="Read pages: connect a machine, read a diagnosis, and more.")
@click.argument("page", required=False, shell_complete=known("page"))
@click.option("--path", "as_path", is_flag=True, help="Print the file's path, not its text.")
@json_option
def command(page: str | None, as_path: bool, as_json: bool) -> None:
    """List the pages, or print PAGE: formatted on a terminal, as Markdown on a pipe.

    Example: ldt docs connect
    """
    from ldt_core import docs

    listed = docs.names() if page is None else [page]
    if as_json:
        found = [{"page": n, "title": docs.title(n), "path": str(docs.path(n))} for n in listed]
        echo_json(found if page is None else found[0])
    elif as_path:
        click.echo("\n".join(str(docs.path(name)) for name in listed))
    elif page is None:
        width = max(map(len, listed))
        click.echo("\n".join(f"{name:{width}}  {docs.title(name)}" for name in listed))
    elif sys.stdout.isatty():
        from rich.console import Console
        from rich.markdown import Markdown

        Console().print(Markdown(docs.text(page)))
    else:
        click.echo(docs.text(page), nl=False)
