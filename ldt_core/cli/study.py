"""`ldt study`: the paper's table and figures, and what goes beyond them."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ldt_core.cli.options import compute_options, json_option, parameters
from ldt_core.cli.outputs import no_empty_folder
from ldt_core.cli.spelling import SuggestingChoice
from ldt_core.cli.terminal import echo_json
from ldt_core.lab.study import GROUPS, NAMED_ONLY

if TYPE_CHECKING:
    from rich.table import Table

    from ldt_core.lab.study.study import Study

QUICK = {"seeds": 2, "experiments": 40}
SEEDS = 20
#: Column of the table → figure, its factor, digits and unit.
FIGURES = {
    "MME, rad/s": ("mme", 1, 2, ""),
    "of original": ("share", 100, 0, " %"),
    "adaptations": ("adaptations", 1, 1, ""),
    "precision": ("precision", 1, 2, ""),
    "recall": ("recall", 1, 2, ""),
}


@click.command("study", short_help="The paper's claims, over many seeds.")
@click.option(
    "-o", "--out", required=True, help="Folder of the study; an earlier one is continued."
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
    help="Part of the study; can be given several times. "
    + "; ".join(f"{name}: {what}" for name, what in GROUPS.items())
    + ".",
)
@compute_options
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
    as_json: bool,
) -> None:
    """Test the paper's claims and what goes beyond them, over many random streams.

    Writes study.html, its figures as PNG and SVG, table.csv and runs.csv. All computed results are
    kept: if interrupted, run the same command again to continue.

    Example: ldt study --seeds 20 --out study
    """
    from ldt_core.cli.progress import ResumableProgress
    from ldt_core.lab.study.engine import conduct
    from ldt_core.lab.study.study_page import write_figures, write_study_page
    from ldt_core.lab.study.study_plan import StudyPlan
    from ldt_core.lab.study.study_tables import write_tables
    from ldt_core.views.page import style

    style.require()
    asked = {"seeds": seeds, "experiments": settings["experiments"]}
    if quick:
        for name, few in QUICK.items():
            if context.get_parameter_source(name) is click.core.ParameterSource.DEFAULT:
                asked[name] = few
    usual = [name for name in GROUPS if name not in NAMED_ONLY]
    groups = tuple(name for name in GROUPS if name in (only or usual))
    plan = StudyPlan(**asked, machine=settings["machine"], groups=groups, first_seed=first_seed)
    with no_empty_folder(out), ResumableProgress("study", "results", out) as progress:
        study = conduct(plan, out, jobs=jobs, scheduler=scheduler, progress=progress.show)
    write_tables(out, study)
    write_figures(study, out)
    _print(study, write_study_page(study, out), as_json)


def _print(study: Study, page: Path, as_json: bool) -> None:
    """The paper's Table 1 beside ours."""
    from rich.box import SIMPLE
    from rich.table import Table

    from ldt_core.cli.console import Console
    from ldt_core.lab.study.study_tables import robust_rows, summary_rows, table_rows

    rows = summary_rows(study)
    if as_json:
        record = {"settings": study.settings, "runs": len(study.entries), "notes": study.notes}
        record |= {"summary": rows, "table": table_rows(study), "robustness": robust_rows(study)}
        echo_json({**record, "page": str(page)})
        return
    table = Table("model", "detector", box=SIMPLE, title="mean over seeds ± its 95 % interval")
    for name in FIGURES:
        table.add_column(name, justify="right")
    for (_, model), members in groupby(rows, key=lambda row: (row["group"], row["model"])):
        for row in members:
            table.add_row(model, row["detector"], *_cells(row))
        if row["paper"]:
            paper = {name: {"value": value} for name, value in row["paper"].items()}
            table.add_row(model, "in the paper", *_cells(paper), style="dim")
        table.add_section()
    console = Console(wide=True)
    if rows:
        console.print(table)
    if study.robust:
        console.print(_streams(study))
    for note in study.notes:
        console.print(note)
    console.print(f"page: {page}")


def _streams(study: Study) -> Table:
    """The default on streams of every kind, beside the references and the paper's two."""
    from rich.box import SIMPLE
    from rich.table import Table

    from ldt_core.lab.statistics import mean
    from ldt_core.lab.study.claims.robust_aims import robust_aims, scored
    from ldt_core.lab.study.robustness.robust_run import DEFAULT, SETUPS

    table = Table("stream", box=SIMPLE, title="left of the original's MME, mean over seeds, %")
    by_setup = {setup: scored(study.robust, setup) for setup in SETUPS}
    for setup in ("late", *SETUPS):
        table.add_column(setup, justify="right")
    table.add_column("aims of the default")
    verdicts = robust_aims(study.robust)
    for name, entries in by_setup[DEFAULT].items():
        late = mean(s.late_left for _, s in entries)
        own = [mean(s.left for _, s in by_setup[setup].get(name, [])) for setup in SETUPS]
        told = ("met" if v.passed else f"missed: {v.aim}" for v in verdicts if v.stream == name)
        cells = [_text(found.as_dict(), 100, 0, "") for found in (late, *own)]
        table.add_row(name, *cells, ", ".join(told))
    for verdict in (v for v in verdicts if not v.stream):
        said = "met" if verdict.passed else "missed"
        table.add_row("all", *[""] * (1 + len(SETUPS)), f"{said}: {verdict.aim}, {verdict.found}")
    return table


def _cells(row: Mapping[str, Any]) -> list[str]:
    return [_text(row[n], scale, digits, unit) for n, scale, digits, unit in FIGURES.values()]


def _text(estimate: Mapping[str, Any], scale: float, digits: int, unit: str) -> str:
    """A mean, and half the width of its interval where it has one."""
    if (value := estimate["value"]) is None:
        return "-"
    low, high = estimate.get("low"), estimate.get("high")
    spread = ""
    if low is not None and high is not None:
        spread = f" ± {scale * (high - low) / 2:.{digits}f}"
    return f"{scale * value:.{digits}f}{spread}{unit}"
