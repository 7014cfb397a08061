"""Pictures of a score: which truth was called what, and closure promised against realised."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.sentences import spoken
from ldt_core.effects import EFFECTS
from ldt_core.lab.challenge.score.judge import Judged
from ldt_core.lab.challenge.score.score_table import POINTS
from ldt_core.views.page import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEFT, ABOVE, AROUND = 2.2, 1.9, 0.1  # inches, for names and about a matrix
CELL = 0.26  # inches
SHOWN = 0.095  # share from which a cell has its number
DARK = 0.55  # share from which that number is white
ENDS = (-0.25, 1.1)  # of a closed fraction as it is drawn; what is beyond lies on the edge
NO_NAME = ("none", "unknown", "failed")  # answers that name nothing


def write_pictures(judged: Sequence[Judged], folder: Path) -> list[str]:
    """Write the pictures as PNG and SVG.

    Returns:
        names of the PNG files.

    Raises:
        LdtError: matplotlib is not installed.
    """
    style.require("a score")
    drawings = []
    for name, left_out in (("confusion", False), ("confusion_left_out", True)):
        chosen = [j for j in judged if (j.truth.kind == "left_out") == left_out]
        chosen = [j for j in chosen if j.truth.kind in ("single", "none", "outside", "left_out")]
        if chosen:
            drawings.append(_confusion(name, chosen))
    if any(j.closure for j in judged):
        drawings.append(_closure(judged))
    return [style.save(drawing, folder)[0].name for drawing in drawings]


def confusion(
    judged: Sequence[Judged],
) -> tuple[list[str], list[str], NDArray[np.float64], list[int]]:
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


def _confusion(name: str, judged: Sequence[Judged]) -> style.Drawing:
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
        name,
        "what was called what",
        "in per cent of the cases of a truth",
        "matrix of true causes against answers",
        draw,
    )


def _words(names: Sequence[str]) -> list[str]:
    return [spoken(name) for name in names]


def _closure(judged: Sequence[Judged]) -> style.Drawing:
    def draw(layout: style.Layout) -> Figure:
        figure, axes = style.panels(layout, 4.3, columns=2, count=2)
        for one, excitation in zip(axes, ("same", "another"), strict=True):
            one.plot(ENDS, ENDS, color=style.INK, linewidth=0.8)
            low, high = ([end + by for end in ENDS] for by in (-POINTS, POINTS))
            one.fill_between(ENDS, low, high, color=style.SHADE, linewidth=0, label="± 5 points")
            for right, color, mark in ((True, style.BLUE, "o"), (False, style.VERMILION, "x")):
                pairs = [
                    j.closure[excitation]
                    for j in judged
                    if excitation in j.closure and j.right is right
                ]
                x, y = np.clip(np.array(pairs).reshape(-1, 2).T, *ENDS)
                label = "right answer" if right else "wrong answer"
                if pairs:  # no room is found for what has no place and is not clipped
                    one.plot(x, y, mark, color=color, label=label, ls="", ms=4, clip_on=False)
            one.set(xlim=ENDS, ylim=ENDS, xlabel="closed fraction promised")
            one.set_ylabel("closed fraction realised")
            one.set_title(f"{excitation} excitation")
        style.legend(figure, axes, layout)
        return figure

    return style.Drawing(
        "closure",
        "closure promised and realised",
        "on further experiments",
        "scatter of closed fractions promised against those realised",
        draw,
    )
