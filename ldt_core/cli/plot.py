"""`ldt plot`: a run as a picture."""

from __future__ import annotations

import click

from ldt_core.cli.options import json_option, namespace_option
from ldt_core.cli.outputs import check_file, force_option
from ldt_core.cli.terminal import echo_result


@click.command("plot", short_help="A run as a picture.")
@click.argument("recording")
@click.option("-o", "--out", required=True, help="File of the picture: .png, .svg or .pdf.")
@force_option
@click.option(
    "--experiment",
    type=int,
    help="Experiment to show over time; by default the one in "
    "which the twin gains most over the original model, or three.",
)
@namespace_option
@click.option("--title", default="", help="Title of the picture.")
@json_option
def command(
    recording: str,
    out: str,
    force: bool,
    experiment: int | None,
    namespace: str,
    title: str,
    as_json: bool,
) -> None:
    """Draw RECORDING, a run of `ldt up`, `run` or `replay`: one experiment, and all errors.

    For a recording that `ldt predict` wrote, it draws experiments with their predictions.

    Example: ldt plot my_run --out my_run.png
    """
    from ldt_core.recording.bag import read_bag
    from ldt_core.views.figures.run_figure import load_run, plot_run

    check_file(out, force)
    bag = read_bag(recording, namespace)
    if bag.topic("prediction") is not None and bag.topic("signal") is None:
        # With the calibration's code, which a run needs none of.
        from ldt_core.views.figures.free_run_panels import draw_predictions

        numbers = draw_predictions(bag, out, title, experiment)
        echo_result(as_json, {"figure": out, "shown": numbers}, out)
        return
    run = load_run(recording, namespace, experiment)
    plot_run(run, out, title)
    shown, count = run.shown.experiment.number, len(run.steps)
    record = {"figure": out, "shown": shown, "experiments": count}
    echo_result(as_json, record, out)
