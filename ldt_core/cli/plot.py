"""`ldt plot`: a run as a picture."""

from __future__ import annotations

import click


@click.command("plot")
@click.argument("recording")
@click.option("--out", required=True, help="File of the picture: .png, .svg or .pdf.")
@click.option(
    "--experiment",
    type=int,
    help="Experiment to show over time; without, the one in "
    "which the twin gained most on the original model.",
)
@click.option(
    "--namespace", default="", help="Machine whose topics are meant, if there are several."
)
@click.option("--title", default="", help="Title of the picture.")
def command(recording: str, out: str, experiment: int | None, namespace: str, title: str) -> None:
    """Draw RECORDING, a run of `ldt up`, `run` or `replay`: one experiment, and all errors.

    Example: ldt plot my_run --out my_run.png
    """
    from ldt_core.figures import load_run, plot_run

    plot_run(load_run(recording, namespace, experiment), out, title)
    click.echo(out)
