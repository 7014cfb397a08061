"""What a score leaves in its folder: numbers, a table, a picture of which truth was called what."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.result_files import write
from ldt_core.base.sentences import counted, number, spoken
from ldt_core.effects import EFFECTS
from ldt_core.lab.challenge.score.answer import DIAGNOSIS
from ldt_core.lab.challenge.score.judge import Judged
from ldt_core.lab.challenge.score.score import SAME_CASES, ChallengeScore
from ldt_core.lab.challenge.score.score_table import EVERY
from ldt_core.lab.statistics import Interval
from ldt_core.views.page import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Kind of cases → in words, and what is right of them.
KINDS = {
    "single": ("single effects", "named, or in its group"),
    "pair": ("pairs", "both named or in their groups"),
    "triple": ("triples", "all named or in their groups"),
    "named": ("all of these", "named or in their groups"),
    "none": ("no gap", "called none"),
    "outside": ("outside the library", "called unknown"),
    "left_out": ("left out of the library", "called unknown, or what closes 95 % of the gap"),
}
#: Figures over all cases, below what is right and what is named wrongly.
QUALITY = (
    "names in a group",
    "amounts: relative error",
    "amounts: error of a factor",
    "amounts: error of an angle [rad]",
    "amounts: 95 % interval covers",
    "amounts: 90 % interval covers",
    "place right",
    "closure within 5 points, same excitation",
    "closure within 5 points, another excitation",
    "closure realised, same excitation",
    "closure realised, another excitation",
    "failed",
    "CPU seconds, median",
    "CPU seconds, most",
)
SHARES = ("right", "wrong", "failed", "place", "amounts: 9", "amounts: rel", "closure")


def _cell(estimate: Interval | None, figure: str) -> str:
    """A figure with interval and count, shares in percent: "86 % [81, 90] of 300"."""
    if estimate is None or estimate.value is None:
        return ""
    percent = figure.startswith(SHARES)
    scale = 100.0 if percent else 1.0
    low, high = (number(scale * bound) for bound in (estimate.low, estimate.high))
    unit = " %" if percent else ""
    spread = "" if estimate.low == -estimate.high else f" [{low}, {high}]"
    return f"{number(scale * estimate.value)}{unit}{spread} of {estimate.count}"


def side_by_side(score: ChallengeScore) -> tuple[list[str], list[list[str]]]:
    """Head and rows of the one table: every figure, of the diagnosis and who else answered."""
    wanted = [("right", k, f"{words}: {right}") for k, (words, right) in KINDS.items()]
    wanted += [("wrong name", k, f"{KINDS[k][0]}: a wrong name") for k in ("named", "outside")]
    wanted += [(figure, EVERY, figure) for figure in QUALITY]
    who = list(score.judged)
    rows = []
    for figure, kind, words in wanted:
        if score.table.get(DIAGNOSIS, figure, kind) is not None:
            rows.append([words, *(_cell(score.table.get(w, figure, kind), figure) for w in who)])
    return ["", *who], rows


def markdown(score: ChallengeScore, picture: str = "") -> str:
    """The whole of `score.md`.

    Args:
        score: what came out.
        picture: name of the file beside it; "" for none.
    """
    versions = ", ".join(f"{name} {value}" for name, value in score.stamp.items())
    head, rows = side_by_side(score)
    lines = ["# Score of a challenge", ""]
    lines += [f"- SHA-256 of {file}: `{digest}`" for file, digest in score.keys.items()]
    lines += [f"- {counted(len(score.judged[DIAGNOSIS]), 'case')}; answers by {versions}"]
    lines += ["- in brackets 95 % intervals: Wilson's of shares, else by draws of cases"]
    lines += ["- amounts are those of truths named outright; score.json has every case"]
    lines += [*(f"- {note}" for note in score.notes), ""]
    lines += [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]
    lines += ["", f"![What was called what]({picture})"] if picture else []
    return "\n".join(lines) + "\n"


def write_score(score: ChallengeScore, folder: str | Path) -> list[Path]:
    """Write score.json, score.md and the pictures.

    Returns:
        the files that a person looks at.

    Raises:
        LdtError: matplotlib is not installed.
    """
    out = Path(folder)
    write(out / "score.json", json.dumps(score_record(score), allow_nan=False, indent=1) + "\n")
    picture = write_picture(score.judged[DIAGNOSIS], out)
    write(out / "score.md", markdown(score, picture))
    return [out / "score.md", out / "score.json", *([out / picture] if picture else [])]


def score_record(score: ChallengeScore) -> dict[str, Any]:
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
        "confidence": (answer.found or {}).get("verdict", {}).get("confidence"),
        "nominal": nominal_said(j),
        "acting": answer.acting,
        "outcome": j.outcome,
        "right": j.right,
        "amounts": [vars(a) | {"covered": a.covered and list(a.covered)} for a in j.amounts],
        "place_right": j.place,
        "closure": {
            name: {"promised": promised, "realised": real if math.isfinite(real) else None}
            for name, (promised, real) in j.closure.items()
        },
        "refused": answer.refused,
        "seconds": answer.seconds,
        "error": answer.error,
    }


def nominal_said(j: Judged) -> bool | None:
    """Whether the answer says that the file's own numbers explain the gap, where they do.

    None where they do not: where something acts, or where they were calibrated.
    """
    if j.truth.kind != "none" or (j.truth.about or {}).get("file") != "datasheet":
        return None
    moved = (j.answer.found or {}).get("refit") or []
    return j.answer.kind == "none" and any(r.get("closed_fraction") is not None for r in moved)


LEFT, ABOVE, AROUND = 2.2, 1.9, 0.1  # inches, for names and about a matrix
CELL = 0.26  # inches
SHOWN = 0.095  # share from which a cell has its number
DARK = 0.55  # share from which that number is white
NO_NAME = ("none", "unknown", "failed")  # answers that name nothing


def write_picture(judged: Sequence[Judged], folder: Path) -> str:
    """Write the matrix as PNG and SVG.

    Returns:
        name of the PNG file; "" without cases to show.

    Raises:
        LdtError: matplotlib is not installed.
    """
    style.require("a score")
    chosen = [j for j in judged if j.truth.kind in ("single", "none", "outside")]
    return style.save(_drawing(chosen), folder)[0].name if chosen else ""


def confusion(
    judged: Sequence[Judged],
) -> tuple[list[str], list[str], Array, list[int]]:
    """(truths, answers, shares of each truth's cases, cases of each truth).

    An answer counts once: shared evenly among the effects that are said to act, and each of these
    among the names of its group.
    """
    library = EFFECTS.names()
    cases = Counter(_row(j) for j in judged)
    order = {name: k for k, name in enumerate([*library, "none"])}
    rows = sorted(cases, key=lambda name: (order.get(name, len(order)), name))
    said = {name for j in judged for group in j.answer.acting for name in group}
    columns = [*library, *sorted(said - set(library)), *NO_NAME[:2]]
    if any(j.outcome == "failed" for j in judged):
        columns.append(NO_NAME[2])
    counts = np.zeros((len(rows), len(columns)))
    for j in judged:
        row, acting = rows.index(_row(j)), j.answer.acting
        if not acting and j.answer.kind in columns:
            counts[row, columns.index(j.answer.kind)] += 1
        for group in acting:
            for name in group:
                counts[row, columns.index(name)] += 1 / len(acting) / len(group)
    numbers = [cases[name] for name in rows]
    return rows, columns, counts / np.array(numbers)[:, None], numbers


def _row(j: Judged) -> str:
    return j.truth.outside or "outside" if j.truth.kind == "outside" else j.truth.name


def _drawing(judged: Sequence[Judged]) -> style.Drawing:
    rows, columns, shares, numbers = confusion(judged)
    library = EFFECTS.names()

    def draw(layout: style.Layout) -> Figure:
        wide, high = CELL * len(columns), CELL * len(rows)
        width, height = LEFT + wide + AROUND, ABOVE + high + AROUND
        figure = style.blank(style.Layout(layout.name, width, False), height)
        figure.set_layout_engine("none")
        place = (LEFT / width, AROUND / height, wide / width, high / height)
        axes = figure.add_axes(place)
        axes.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="equal")
        axes.set_xticks(range(len(columns)), _words(columns), rotation=90)
        axes.set_yticks(
            range(len(rows)),
            [f"{w}  ({n})" for w, n in zip(_words(rows), numbers, strict=True)],
        )
        axes.xaxis.tick_top()
        axes.xaxis.set_label_position("top")
        axes.tick_params(length=0)
        axes.grid(False)
        axes.set_xticks(np.arange(-0.5, len(columns)), minor=True)
        axes.set_yticks(np.arange(-0.5, len(rows)), minor=True)
        axes.grid(which="minor", color=style.FAINT, linewidth=0.5)
        axes.tick_params(which="minor", length=0)
        axes.set_xlabel("answer (groups shared among their names)")
        axes.set_ylabel("truth (cases)")
        named = sum(r in library for r in rows)
        for at in {named, named + ("none" in rows)} - {0, len(rows)}:
            axes.axhline(at - 0.5, color=style.INK, linewidth=1.0)
        axes.axvline(columns.index("none") - 0.5, color=style.INK, linewidth=1.0)
        for (r, c), share in np.ndenumerate(shares):
            if share >= SHOWN:
                color = style.PAPER if share > DARK else style.INK
                middle: dict[str, Any] = {"ha": "center", "va": "center"}
                axes.text(c, r, f"{100 * share:.0f}", color=color, fontsize=6.5, **middle)
        return figure

    return style.Drawing(
        "confusion",
        "what was called what",
        "in per cent of the cases of a truth",
        "matrix of true causes against answers",
        draw,
    )


def _words(names: Sequence[str]) -> list[str]:
    return [spoken(name) for name in names]
