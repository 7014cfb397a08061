"""`ldt diagnose`: where the gap between a machine and its file lies, and what causes it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.table import Table

from ldt_core.cli.options import parameters
from ldt_core.cli.recordings import progress, read_recordings

if TYPE_CHECKING:
    from ldt_core.diagnosis.result import Diagnosis

SHOWN = 8  # candidates in the table of the terminal; the page has all


@click.command("diagnose")
@click.argument("recordings", nargs=-1, required=True)
@parameters("machine")
@click.option(
    "--holdout",
    type=float,
    default=0.25,
    show_default=True,
    metavar="FRACTION",
    help="Share of the experiments that closure is measured on, not fitted.",
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of what is drawn at random.")
@click.option(
    "--effect",
    "more",
    multiple=True,
    metavar="FILE.py:NAME",
    help="Further effect of your own to try; can be given several times.",
)
@click.option(
    "--without",
    multiple=True,
    metavar="NAME",
    help="Effect not to try; can be given several times.",
)
@click.option(
    "--refit",
    metavar="NAME,...",
    help="Parameters of the machine to fit along and never to name, or none; those that the file "
    "says were calibrated if not given.",
)
@click.option("--namespace", default="", help="Machine whose topics are meant, if several.")
@click.option(
    "--out", required=True, help="Folder for diagnosis.json and diagnosis.html; made if need be."
)
@click.option("--json", "as_json", is_flag=True, help="Print diagnosis.json and nothing else.")
def command(
    settings: dict[str, Any],
    recordings: tuple[str, ...],
    holdout: float,
    seed: int,
    more: tuple[str, ...],
    without: tuple[str, ...],
    refit: str | None,
    namespace: str,
    out: str,
    as_json: bool,
) -> None:
    """Say where the gap between RECORDINGS and the machine file lies, which effect that the file
    lacks causes it, and how far adding it closes the gap on experiments that were held back.

    The answer can be none (no gap), an effect or several together, a group that these recordings
    cannot tell apart, or unknown.

    Example: ldt diagnose bag --machine rotor --out diagnosis
    """
    from ldt_core.diagnosis.own import own_effects
    from ldt_core.diagnosis.page import write_page
    from ldt_core.diagnosis.procedure import diagnose, library
    from ldt_core.machine import load_machine

    machine = load_machine(settings["machine"])
    effects = library(machine, more, without)
    fitted_along = None if refit is None else [n.strip() for n in refit.split(",")]
    own_effects(machine, fitted_along)
    folder = _folder(out)
    experiments = read_recordings(recordings, namespace, machine)
    with progress("{}: {}") as tick:
        found = diagnose(
            machine,
            experiments,
            recordings=recordings,
            effects=effects,
            refit=fitted_along,
            holdout=holdout,
            seed=seed,
            tick=tick,
        )
        tick("drawing the page")
        text = json.dumps(found.as_dict(), allow_nan=False, indent=1)
        (folder / "diagnosis.json").write_text(text + "\n", encoding="utf-8")
        write_page(found, folder / "diagnosis.html")
    if as_json:
        click.echo(text)
    else:
        _print(found, folder)


def _folder(out: str) -> Path:
    from ldt_core.errors import BadInput

    folder = Path(out)
    if folder.exists() and not folder.is_dir():
        raise BadInput("--out", "a folder", f"the file {out}")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _print(found: Diagnosis, folder: Path) -> None:
    from ldt_core.diagnosis.words import values

    console = Console(soft_wrap=True)
    console.print(found.verdict.sentence, markup=False, highlight=False)
    if found.verdict.kind != "none":
        table = Table(title="what was tried, each alone")
        for column in ("effect", "explains", "amount", "why not"):
            table.add_column(column, justify="right" if column == "explains" else "left")
        for c in found.candidates[:SHOWN]:
            share = "" if c.closed_fraction is None else f"{c.closed_fraction:.1%}"
            table.add_row(c.effect, share, values(c.parameters), c.rejected_because or "named")
        console.print(table)
    if found.remainder.structured and found.remainder.depends_on:
        depends = ", ".join(found.remainder.depends_on)
        console.print(f"what is left depends on {depends}", markup=False, highlight=False)
    if found.undetectable:
        silent = ", ".join(found.undetectable)
        console.print(f"could not have shown here: {silent}", markup=False, highlight=False)
    if found.next_experiment is not None:
        console.print(f"next: {found.next_experiment.why}", markup=False, highlight=False)
    for note in found.notes:
        console.print(f"- {note}", markup=False, highlight=False)
    console.print(
        f"{folder / 'diagnosis.html'}, {folder / 'diagnosis.json'}", markup=False, highlight=False
    )
