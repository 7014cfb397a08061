"""What a score leaves in its folder: numbers, words and tables, pictures."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ldt_core.base.result_files import write
from ldt_core.base.sentences import number
from ldt_core.lab.challenge.comparators import WORDS
from ldt_core.lab.challenge.score.answer import DIAGNOSIS
from ldt_core.lab.challenge.score.judge import Judged
from ldt_core.lab.challenge.score.pictures import write_pictures
from ldt_core.lab.challenge.score.score import SAME_CASES, ChallengeScore
from ldt_core.lab.challenge.score.score_table import BINS, EVERY, OUTCOMES
from ldt_core.lab.study.statistics import Interval

KINDS = {
    "single": "single effects",
    "pair": "pairs",
    "triple": "triples",
    "named": "all of these",
    "none": "no gap",
    "outside": "outside the library",
    "left_out": "left out of the library",
}
#: What is right, by kind.
RIGHT = {
    "none": "called none",
    "outside": "called unknown",
    "left_out": "called unknown, or by what closes 95 % of the gap",
}
NAMED = "truth named or in its group"
#: Figures of the diagnosis beside the shares of outcomes: (figure, kind of cases), unit of shares.
QUALITY = (
    "names in a group",
    "amounts: relative error",
    "amounts: error of a factor",
    "amounts: error of an angle [rad]",
    "amounts: with an interval",
    "amounts: 95 % interval covers",
    "amounts: 90 % interval covers",
    "place right",
    "closure within 5 points, same excitation",
    "closure within 5 points, another excitation",
    "closure off by, same excitation",
    "closure off by, another excitation",
    "CPU seconds, median",
    "CPU seconds, most",
)
SHARES = ("right", *OUTCOMES, "place", "amounts: with", "amounts: 9", "amounts: rel", "closure")


def cell(estimate: Interval | None, figure: str) -> str:
    """A figure with interval and count, shares in percent: "86 % [81, 90] of 300"."""
    if estimate is None or estimate.value is None:
        return ""
    percent = figure.startswith(SHARES)
    scale, digits = (100.0, 3) if percent else (1.0, 3)
    low, high = (number(scale * bound, digits) for bound in (estimate.low, estimate.high))
    unit = " %" if percent else ""
    spread = "" if estimate.low == -estimate.high else f" [{low}, {high}]"
    return f"{number(scale * estimate.value, digits)}{unit}{spread} of {estimate.count}"


def headline(score: ChallengeScore) -> list[tuple[str, str, Interval | None]]:
    """(cases, what is right, share) of the diagnosis, for a short table."""
    return [
        (words, RIGHT.get(kind, NAMED), score.table.get(DIAGNOSIS, "right", kind))
        for kind, words in KINDS.items()
        if score.table.get(DIAGNOSIS, "right", kind) is not None
    ]


def quality(score: ChallengeScore) -> list[tuple[str, Interval | None]]:
    """(figure, value) of the diagnosis over all cases."""
    found = [(figure, score.table.get(DIAGNOSIS, figure)) for figure in QUALITY]
    return [(figure, estimate) for figure, estimate in found if estimate is not None]


def versus(score: ChallengeScore) -> tuple[list[str], list[list[str]]]:
    """Head and rows of the table that sets everybody side by side."""
    kinds = [k for k in KINDS if score.table.get(DIAGNOSIS, "right", k) is not None]
    figures = [("right", k, KINDS[k]) for k in kinds]
    figures += [
        ("wrong name", k, f"wrong name, {KINDS[k]}") for k in ("named", "outside") if k in kinds
    ]
    figures += [
        (f"closure realised, {e} excitation", EVERY, f"gap closed, {e} excitation")
        for e in ("same", "another")
    ]
    figures.append(("CPU seconds, median", EVERY, "CPU seconds, median"))
    who = [w for w in score.judged if w != DIAGNOSIS or SAME_CASES not in score.judged]
    who.sort(key=lambda w: w != SAME_CASES)
    rows = [
        [words, *(cell(score.table.get(w, figure, kind), figure) for w in who)]
        for figure, kind, words in figures
    ]
    return ["", *who], rows


def markdown(score: ChallengeScore, pictures: Sequence[str] = ()) -> str:
    """The whole of `score.md`.

    Args:
        score: what came out.
        pictures: names of the files beside it.
    """
    table, lines = score.table, ["# Score of a challenge", ""]
    lines += [f"- SHA-256 of {file}: `{digest}`" for file, digest in score.keys.items()]
    lines += [f"- {len(score.judged[DIAGNOSIS])} cases; answers by {_versions(score.stamp)}"]
    lines += ["- in brackets 95 % intervals: Wilson's of shares, else by draws of cases"]
    lines += [f"- {note}" for note in score.notes]
    lines += ["", "## The diagnosis", ""]
    rows = [[words, what, cell(e, "right")] for words, what, e in headline(score)]
    lines += _table(["cases", "right is", "right"], rows)
    lines += ["", "What was answered:", ""]
    kinds = [k for k in KINDS if table.get(DIAGNOSIS, "right", k) is not None]
    outcomes = [[f, *(cell(table.get(DIAGNOSIS, f, k), f) for k in kinds)] for f in OUTCOMES]
    lines += _table(["", *(KINDS[k] for k in kinds)], outcomes)
    lines += [
        "",
        "*Named in part* names true effects only, but not all; *wrong name* also counts a name too "
        "many; *failed* is a crash.",
        "",
        "Right, by signal to noise (root mean square of the gap over the noise):",
        "",
    ]
    rows = [
        [KINDS[k], *(cell(table.get(DIAGNOSIS, "right", k, b), "right") for b in BINS)]
        for k in kinds
        if k != "none"
    ]
    lines += _table(["cases", *BINS], rows)
    lines += ["", "How good the answers are:", ""]
    rows = [
        [f, cell(e, f), *(cell(table.get(DIAGNOSIS, f, EVERY, b), f) for b in BINS)]
        for f, e in quality(score)
    ]
    lines += _table(["", "all", *BINS], rows)
    lines += [
        "",
        "Amounts are those of truths named outright, their number that of cases for errors and of "
        "parameters for shares; of a factor the relative error is that of its distance from 1. "
        "Closure promised on held-out experiments is compared with that realised on further ones, "
        "noise subtracted from both, on these as it fell out if the key has it; else, with a gap "
        "below the noise, their difference is itself known to several points only.",
    ]
    for name in pictures:
        lines += ["", f"![{name.rpartition('.')[0]}]({name})"]
    if len(score.judged) > 1:
        lines += ["", "## Comparators", "", "On the same cases, with the same library.", ""]
        lines += [f"- {who}: {WORDS[who]}" for who in score.judged if who in WORDS]
        lines += ["", *_table(*versus(score))]
    lines += ["", "## Where the diagnosis was wrong", ""]
    wrong = [j for j in score.judged[DIAGNOSIS] if not j.right]
    lines += _table(["case", "signal to noise", "truth", "answer"], map(_case, wrong))
    return "\n".join(lines) + "\n"


def said(judged: Judged) -> str:
    """An answer in words."""
    if not judged.answer.acting:
        return judged.answer.kind + (f": {judged.answer.error}" if judged.answer.error else "")
    return " + ".join(" or ".join(group) for group in judged.answer.acting)


def _case(j: Judged) -> list[str]:
    ratio = j.truth.signal_to_noise
    left = " (left out)" if j.truth.left_out else ""
    return [j.truth.case, "" if ratio is None else number(ratio), j.truth.name + left, said(j)]


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    def line(cells: Sequence[str]) -> str:
        safe = (c.replace("|", "\\|").replace("\n", " ") for c in cells)
        return f"| {' | '.join(safe)} |"

    return [line(head), line(["---"] * len(head)), *(line(r) for r in rows)]


def _versions(stamp: dict[str, str]) -> str:
    return ", ".join(f"{name} {value}" for name, value in stamp.items())


def write_files(score: ChallengeScore, folder: str | Path) -> list[Path]:
    """Write score.json, score.md and the pictures.

    Returns:
        the files that a person looks at.

    Raises:
        LdtError: matplotlib is not installed.
    """
    out = Path(folder)
    write(out / "score.json", json.dumps(as_dict(score), allow_nan=False, indent=1) + "\n")
    pictures = write_pictures(score.judged[DIAGNOSIS], out)
    write(out / "score.md", markdown(score, pictures))
    return [out / "score.md", out / "score.json", *(out / name for name in pictures)]


def as_dict(score: ChallengeScore) -> dict[str, Any]:
    """The content of `score.json`."""
    return {
        "keys": [{"file": file, "sha256": digest} for file, digest in score.keys.items()],
        "stamp": dict(score.stamp),
        "notes": list(score.notes),
        "figures": [row.as_dict() for row in score.table.rows],
        "cases": [
            {"who": who, **_plain(j)}
            for who, judged in score.judged.items()
            if who != SAME_CASES
            for j in judged
        ],
    }


def _plain(j: Judged) -> dict[str, Any]:
    truth, answer = j.truth, j.answer
    return {
        "case": truth.case,
        "kind": truth.kind,
        "effects": list(truth.effects),
        "outside": truth.outside,
        "signal_to_noise": truth.signal_to_noise,
        "verdict": answer.kind,
        "acting": answer.acting,
        "outcome": j.outcome,
        "right": j.right,
        "amounts": [vars(a) | {"covered": a.covered and list(a.covered)} for a in j.amounts],
        "place_right": j.place,
        "closure": {
            name: {"promised": promised, "realised": real if math.isfinite(real) else None}
            for name, (promised, real) in j.closure.items()
        },
        "seconds": answer.seconds,
        "error": answer.error,
    }
