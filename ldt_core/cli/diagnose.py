"""`ldt diagnose`: where the gap between a machine and its file lies, and what causes it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.table import Table

from ldt_core.base.printable import one_line
from ldt_core.base.sentences import certainty, confident, listed
from ldt_core.base.settings import HOLDOUT, as_options
from ldt_core.cli.completion import known
from ldt_core.cli.console import Console
from ldt_core.cli.options import (
    compute_options,
    declared_option,
    namespace_option,
    parameters,
)
from ldt_core.cli.outputs import check_file, check_results, force_option, no_empty_folder
from ldt_core.cli.progress import ResumableProgress, status
from ldt_core.cli.terminal import echo_json, echo_json_text, warn

if TYPE_CHECKING:
    from ldt_core.diagnosis.diagnosis import Diagnosis
    from ldt_core.machine.machine_file import Machine
    from ldt_core.runs.each_recording import Options, RecordingAnswer

MAX_CANDIDATES = 8  # candidates in the table of the terminal; the page has all


@click.command("diagnose", short_help="Where the gap lies, and which effect causes it.")
@click.argument("recordings", nargs=-1, required=True)
@parameters("machine")
@click.option(
    "--holdout",
    type=float,
    default=HOLDOUT,
    show_default=True,
    metavar="FRACTION",
    help="Share of the experiments that are held out to measure the closure.",
)
@click.option(
    "--seed",
    type=click.IntRange(0, 2**32 - 1),
    default=0,
    show_default=True,
    help="Seed of all random numbers.",
)
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
    shell_complete=known("effect"),
    help="Effect not to try; can be given several times.",
)
@click.option(
    "--refit",
    metavar="NAME,...",
    help="Machine parameters to fit too, within their tolerances, or none; by default those with a "
    "standard deviation in the file, or calibrated.",
)
@declared_option("only")
@namespace_option
@click.option(
    "-o",
    "--out",
    required=True,
    help="Folder for diagnosis.json and diagnosis.html; created if necessary.",
)
@force_option
@click.option(
    "--each",
    is_flag=True,
    help="Diagnose every recording separately, several in parallel, each into its own folder under "
    "--out; an interrupted run continues.",
)
@compute_options
@click.option(
    "--figure",
    metavar="FILE",
    help="Draw before and after, where the gap lies, and the shares of a set (.png, .svg, .pdf).",
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
    only: str,
    namespace: str,
    out: str,
    force: bool,
    each: bool,
    jobs: int,
    scheduler: str,
    figure: str | None,
    as_json: bool,
) -> int:
    """Say where the gap between RECORDINGS and the machine file lies, which missing effect causes
    it, and how much of the gap this effect closes on held-out experiments.

    The answer can be none (no gap), one effect or several, a group that these recordings cannot
    tell apart, or unknown. Several recordings are treated as one machine and diagnosed together,
    unless --each is given.

    Example: ldt diagnose bag --machine rotor --out diagnosis
    """
    from ldt_core.base.errors import BadInput
    from ldt_core.cli.recordings import naming, read_recordings
    from ldt_core.diagnosis.diagnose import diagnose
    from ldt_core.diagnosis.library import library
    from ldt_core.diagnosis.nominal_prior import nominal_prior
    from ldt_core.machine.machine_file import load_machine
    from ldt_core.runs.each_recording import Options
    from ldt_core.views.diagnosis_page.diagnosis_page import JSON, PAGE, picture, write_diagnosis
    from ldt_core.views.diagnosis_page.diagnosis_page import as_json as in_json
    from ldt_core.views.page import style

    machine = load_machine(settings["machine"])
    effects = library(machine, more, without)
    fitted_along = None if refit is None else [n.strip() for n in refit.split(",")]
    nominal_prior(machine, fitted_along)
    if (jobs or scheduler) and not each:
        raise BadInput("--jobs" if jobs else "--scheduler", "--each with it", "a single diagnosis")
    if figure:
        if each:
            raise BadInput("--figure", "a single diagnosis", "--each")
        style.check_picture(figure, "--figure", "--figure")
        check_file(figure, force, "--figure")
    folder = Path(out)
    check_results(folder, () if each else (JSON, PAGE), force)
    if each:
        along = None if fitted_along is None else tuple(fitted_along)
        options = Options(namespace, more, without, along, holdout, seed, only)
        with no_empty_folder(folder):
            folder.mkdir(parents=True, exist_ok=True)
            return _each(recordings, machine, folder, options, (jobs, scheduler), as_json)
    experiments = read_recordings(recordings, namespace, machine, only)
    with no_empty_folder(folder), naming(recordings), status("{}: step {}") as tick:
        folder.mkdir(parents=True, exist_ok=True)
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
        write_diagnosis(found, folder)
        if figure:
            picture(found, figure)
    if as_json:
        echo_json_text(in_json(found))
    else:
        _print(found, folder, only)
    return 0


def _each(
    recordings: tuple[str, ...],
    machine: Machine,
    folder: Path,
    options: Options,
    where: tuple[int, str],
    as_json: bool,
) -> int:
    """Diagnose recordings one by one; the exit code is that of the worst."""
    from ldt_core.runs.each_recording import diagnose_each

    def say(answer: RecordingAnswer) -> None:
        warn(*answer.notes, *([f"ldt: {answer.error}"] if answer.error else []))

    with ResumableProgress("diagnose", "recordings", str(folder)) as bar:
        answers = diagnose_each(
            recordings,
            machine,
            folder,
            options,
            jobs=where[0],
            scheduler=where[1],
            say=say,
            progress=bar.show,
        )
    _print_each(answers, folder, as_json)
    return max(a.exit_code for a in answers)


def _print_each(answers: Sequence[RecordingAnswer], out: Path, as_json: bool) -> None:
    if as_json:
        listed = []
        for a in answers:
            about = {"recording": a.recording, "out": str(a.folder), "error": a.error or None}
            listed.append({**about, "diagnosis": a.found})
        echo_json(listed, indent=1)
        return
    table = Table(title="verdicts")
    for column in ("recording", "verdict", "effects", "confidence", "explains", "error, rad/s"):
        right = column in ("confidence", "explains")
        table.add_column(column, justify="right" if right else "left")
    for a in answers:
        table.add_row(*_row(a))
    console = Console(wide=True)
    console.print_folded(table)
    console.print(f"{out}: a folder for each")


def _row(a: RecordingAnswer) -> list[str]:
    if a.found is None:
        return [a.recording, "failed", "", "", "", ""]
    verdict, gap = a.found["verdict"], a.found["gap"]
    effects = " and ".join(" or ".join(group) for group in verdict["acting"])
    closed = "" if gap["closed_fraction"] is None else f"{gap['closed_fraction']:.1%}"
    was, now = gap["before"]["rmse"], gap["after"]["rmse"]
    change = f"{was:.3g}" if was == now else f"{was:.3g} to {now:.3g}"
    sure = certainty(verdict["confidence"])
    return [a.recording, verdict["kind"], effects, sure, closed, change]


def _print(found: Diagnosis, folder: Path, only: str = "") -> None:
    from ldt_core.diagnosis.sentence import applied, unsought, values
    from ldt_core.views.diagnosis_page.diagnosis_page import JSON, PAGE
    from ldt_core.views.diagnosis_page.next_step import next_step

    console = Console()
    console.print(found.verdict.sentence)
    sought = not unsought(found.verdict)
    if sought:
        console.print(confident(found.verdict.confidence))
    if sought and found.verdict.kind != "none":
        table = Table(title="what was tried, and what it explains alone of the gap held out")
        for column in ("effect", "explains", "amount", "verdict"):
            table.add_column(column, justify="right" if column == "explains" else "left")
        for c in found.candidates[:MAX_CANDIDATES]:
            share = "" if c.closed_fraction is None else f"{c.closed_fraction:.1%}"
            table.add_row(c.effect, share, values(c.parameters), c.rejected_because or "named")
        console.print_folded(table, "effect", "explains")
    if found.remainder.structured and found.remainder.depends_on:
        depends = ", ".join(found.remainder.depends_on)
        console.print(f"what is left depends on {depends}")
    if found.undetectable:
        silent = ", ".join(found.undetectable)
        console.print(f"could not have shown here: {silent}")
    if (then := found.next_experiment) is not None:
        console.print(f"next: {then.why}")
        console.print(
            f"voltage: {applied(then)}, {len(then.voltage)} samples of {then.sample_period:g} s "
            f"(in {JSON}); record {listed(then.channels)}"
        )
    for note in found.notes:
        console.print(one_line(f"- {note}"))
    console.print(f"{folder / PAGE}, {folder / JSON}")
    words, command = next_step(found, folder / JSON)
    if command:
        if "--machine" in command and "--only" not in command:
            command = f"{command} {as_options({'only': only})}".rstrip()
        console.print(one_line(f"Next, {words}: {command}"), soft_wrap=True)
