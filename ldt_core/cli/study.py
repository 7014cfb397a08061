"""`ldt study`: the paper's table and figures, and what goes beyond them."""

from __future__ import annotations

from typing import Any

import click

from ldt_core.cli.options import json_option, parameters
from ldt_core.cli.resumable import ResumableProgress, compute_options
from ldt_core.cli.spelling import SuggestingChoice
from ldt_core.lab.study.groups import GROUPS

QUICK = {"seeds": 2, "experiments": 40}
SEEDS = 20


@click.command("study", short_help="The paper's claims, over many seeds.")
@click.option(
    "-o", "--out", required=True, help="Folder of the study; an earlier one goes on there."
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 10_000),
    default=SEEDS,
    show_default=True,
    help="Number of random streams; every run is made on each.",
)
@click.option(
    "--first-seed",
    type=click.IntRange(0, 2**32 - 1),
    default=0,
    show_default=True,
    help="Seed of the first stream; the others follow.",
)
@parameters("machine", "run")
@click.option("--quick", is_flag=True, help="To try it out: 2 seeds and 40 experiments.")
@click.option(
    "--only",
    type=SuggestingChoice(list(GROUPS)),
    multiple=True,
    help="Part of the study; may be given several times. "
    + "; ".join(f"{name}: {what}" for name, what in GROUPS.items())
    + ".",
)
@compute_options
@click.option("--fresh", is_flag=True, help="Compute anew what an earlier study has left there.")
@click.option("--page-only", is_flag=True, help="Write tables and page from what is there.")
@json_option
@click.pass_context
def command(
    context: click.Context,
    settings: dict[str, Any],
    out: str,
    seeds: int,
    first_seed: int,
    quick: bool,
    only: tuple[str, ...],
    jobs: int,
    scheduler: str,
    fresh: bool,
    page_only: bool,
    as_json: bool,
) -> None:
    """Test the paper's claims and what goes beyond them, over many random streams.

    Writes study.html, its figures as PNG and SVG, table.csv and runs.csv. Whatever has been
    computed is kept: the same command goes on where an earlier one was interrupted.

    Example: ldt study --seeds 20 --out study
    """
    from ldt_core.cli.display_study import print_study
    from ldt_core.lab.study.engine import conduct, load_study
    from ldt_core.lab.study.page import write_figures, write_page
    from ldt_core.lab.study.plan import Plan
    from ldt_core.lab.study.tables import write_tables
    from ldt_core.views.page import style

    style.require()
    if page_only:
        study = load_study(out)
    else:
        asked = {"seeds": seeds, "experiments": settings["experiments"]}
        if quick:
            for name, few in QUICK.items():
                if context.get_parameter_source(name) is click.core.ParameterSource.DEFAULT:
                    asked[name] = few
        groups = tuple(name for name in GROUPS if not only or name in only)
        plan = Plan(**asked, machine=settings["machine"], groups=groups, first_seed=first_seed)
        with ResumableProgress("study", "results", out) as progress:
            options: dict[str, Any] = {"jobs": jobs, "scheduler": scheduler, "fresh": fresh}
            study = conduct(plan, out, **options, progress=progress.show)
    write_tables(out, study)
    write_figures(study, out)
    print_study(study, write_page(study, out), as_json)
