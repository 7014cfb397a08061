"""`ldt challenge`: sealed cases, to try a diagnosis on what it cannot know."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ldt_core.cli.options import compute_options, jobs_option, json_option
from ldt_core.cli.outputs import no_empty_folder
from ldt_core.cli.spelling import SuggestingGroup
from ldt_core.cli.terminal import echo, echo_json, echo_result

if TYPE_CHECKING:
    from ldt_core.lab.challenge.score.score import ChallengeScore


@click.group(
    "challenge", cls=SuggestingGroup, short_help="How often the diagnosis is right on sealed cases."
)
def command() -> None:
    """Generate sealed cases for the diagnosis, and score it on them.

    Example: ldt challenge make --cases 20 --seed 1 --out cases
    """


@command.command("make", short_help="Write sealed cases, and their key separately.")
@click.option("--cases", type=click.IntRange(1, 9999), required=True, help="Number of cases.")
@click.option(
    "--seed",
    type=click.IntRange(0, 2**32 - 1),
    required=True,
    help="Seed of all random numbers; whoever knows it can make the key.",
)
@click.option("-o", "--out", required=True, help="Folder of the cases, which must not exist.")
@click.option(
    "--key",
    default="",
    metavar="FILE",
    help="File of the answers; by default FOLDER.key.json next to the folder.",
)
@click.option(
    "--leave-one-out",
    is_flag=True,
    help="Single effects only, each removed in turn from the library of the diagnosis.",
)
@click.option(
    "--exact",
    is_flag=True,
    help="Machine files with the true numbers, in place of numbers that were calibrated on noisy "
    "records of the healthy machine.",
)
@jobs_option
@json_option
def make(
    cases: int,
    seed: int,
    out: str,
    key: str,
    leave_one_out: bool,
    exact: bool,
    jobs: int,
    as_json: bool,
) -> None:
    """Write sealed cases, and their answers into a separate key.

    Each case is a folder with a machine file, a recording to diagnose, and a recording of further
    experiments of the same machine. The SHA-256 of the key is printed before any case is written,
    so that you can publish it before the answers.

    Example: ldt challenge make --cases 20 --seed 1 --out cases
    """
    from ldt_core.cli.progress import track
    from ldt_core.lab.challenge.known_file import known_file
    from ldt_core.lab.challenge.make import exact_file, make_challenge

    digests: list[str] = []

    def say(digest: str) -> None:
        digests.append(digest)
        echo(f"SHA-256 of the key: {digest}", err=as_json)

    written = make_challenge(
        cases,
        seed,
        out,
        key,
        leave_one_out=leave_one_out,
        known=exact_file if exact else known_file,
        jobs=jobs,
        say=say,
        progress=lambda items, total, doing: track(items, doing, total),
    )
    record = {"cases": cases, "out": out, "key": str(written), "sha256": digests[0]}
    echo_result(as_json, record, f"{cases} cases: {out}; key: {written}")


@command.command("score", short_help="Diagnose the cases and compare with the key.")
@click.argument("folder")
@click.argument("keys", nargs=-1, required=True)
@click.option(
    "-o",
    "--out",
    default="",
    help="Folder of answers and score, by default FOLDER.score; an interrupted score continues.",
)
@click.option(
    "--comparators/--no-comparators",
    default=False,
    help="Let other methods answer the same cases too; that takes longer than the diagnosis.",
)
@click.option(
    "--subset",
    type=click.IntRange(0, 9999),
    default=0,
    metavar="N",
    help="Let comparators answer the first N cases only; their order is random.",
)
@compute_options
@json_option
def score(
    folder: str,
    keys: tuple[str, ...],
    out: str,
    comparators: bool,
    subset: int,
    jobs: int,
    scheduler: str,
    as_json: bool,
) -> None:
    """Diagnose every case in FOLDER, then open KEYS and compare.

    The SHA-256 of the keys is printed first. Until all answers are on disk, only the names of cases
    and of removed effects are read from a key. Writes diagnosis.json for each case, and score.json,
    score.md and a picture.

    Example: ldt challenge score cases cases.key.json --out score
    """
    from ldt_core.cli.progress import ResumableProgress
    from ldt_core.lab.challenge.score.score import OUT_SUFFIX, score_challenge
    from ldt_core.lab.challenge.score.score_files import write_score
    from ldt_core.views.page import style

    style.require("a score")
    place = Path(folder).resolve()
    target = Path(out) if out else place.with_name(place.name + OUT_SUFFIX)

    def say(file: str, digest: str) -> None:
        echo(f"SHA-256 of {file}: {digest}", err=as_json)

    with no_empty_folder(target), ResumableProgress("score", "answers", str(target)) as progress:
        found = score_challenge(
            folder,
            keys,
            target,
            comparators=comparators,
            subset=subset,
            jobs=jobs,
            scheduler=scheduler,
            say=say,
            progress=progress.show,
        )
    _print(found, write_score(found, target), as_json)


def _print(score: ChallengeScore, files: Sequence[Path], as_json: bool) -> None:
    from rich.box import SIMPLE
    from rich.table import Table

    from ldt_core.cli.console import Console
    from ldt_core.lab.challenge.score.score_files import score_record, side_by_side

    if as_json:
        echo_json(score_record(score))
        return
    console = Console(wide=True)
    head, rows = side_by_side(score)
    table = Table(*head, box=SIMPLE, title="95 % intervals")
    for row in rows:
        table.add_row(*row)
    console.print(table)
    for note in score.notes:
        console.print(note)
    listed = ", ".join(str(f) for f in files)
    console.print(listed)
