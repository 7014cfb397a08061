"""How the candidates fare: what each closes alone, and what each of a set contributes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ldt_core.base.sentences import counted, listed
from ldt_core.diagnosis.diagnosis import Diagnosis, RankedCandidate
from ldt_core.views.diagnosis_page.number_format import known, percent
from ldt_core.views.page.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PAPER,
    PURPLE,
    SKY,
    Drawing,
    Layout,
    Panels,
    blank,
    legend,
    short,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

LONGEST = 24  # letters of a name: names of users' own effects are paths
BARS = 16  # at most: more are in the table
ROW = 0.26  # inches of a bar
AROUND = 0.95  # inches of legend and axis
LEAST_SHOWN = -0.25  # closed fraction below which a bar is cut: it says that the fit went wrong
SIGNS = {"found": ("● ", BLUE), "vague": ("◆ ", ORANGE), "": ("", GREY)}
PARTS = (BLUE, ORANGE, GREEN, PURPLE, SKY, GREY)


def standing(diagnosis: Diagnosis, candidate: RankedCandidate) -> str:
    """found, where the verdict names a candidate; vague, where it may be it; else nothing."""
    groups = [group for group in diagnosis.verdict.acting if candidate.effect in group]
    named = candidate.effect in diagnosis.verdict.effects
    if not (groups or named) or diagnosis.verdict.kind not in ("effect", "ambiguous"):
        return ""
    sure = diagnosis.verdict.kind == "effect" or any(len(group) == 1 for group in groups)
    return "found" if sure else "vague"


def bars(diagnosis: Diagnosis) -> Drawing | None:
    """What each closes alone; None where there is no gap to close."""
    known_ = [c for c in diagnosis.candidates if known(c.closed_fraction)]
    marked = [c for c in known_ if standing(diagnosis, c)]
    others = [c for c in known_ if not standing(diagnosis, c)][: max(BARS - len(marked), 0)]
    drawn = [c for c in known_ if c in marked or c in others]
    if not drawn:
        return None
    whole = diagnosis.gap.closed_fraction
    together = len([c for c in marked if known(c.shapley_share)]) > 1 and known(whole)

    def draw(layout: Layout) -> Figure:
        figure = blank(layout, AROUND + ROW * len(drawn))
        axes = figure.subplots()
        signs = [SIGNS[standing(diagnosis, c)] for c in drawn]
        closed = [float(c.closed_fraction or 0.0) for c in drawn]
        length = [100 * min(max(value, LEAST_SHOWN), 1.0) for value in closed]
        axes.barh(range(len(drawn)), length, height=0.66, color=[color for _, color in signs])
        for row, value in enumerate(closed):
            at = max(length[row], 0.0)
            box = {"facecolor": PAPER, "edgecolor": "none", "pad": 1.0}
            axes.text(at + 1.2, row, percent(value), va="center", color=INK, bbox=box)
        names = [
            f"{sign}{short(c.effect, LONGEST)}" for c, (sign, _) in zip(drawn, signs, strict=True)
        ]
        axes.set_yticks(range(len(drawn)), names)
        for text, (sign, _) in zip(axes.get_yticklabels(), signs, strict=True):
            text.set_fontweight("bold" if sign else "normal")
        if together and whole is not None:
            label = f"all of the verdict together: {percent(whole)}"
            axes.axvline(100 * whole, color=INK, ls=(0, (4, 1.4)), lw=1.2, label=label)
        axes.axvline(0, color=INK, lw=0.8)
        axes.spines["left"].set_visible(False)
        axes.set_xlim(min(0.0, *length) - (3 if min(length) < 0 else 0), 112)
        axes.set_xticks(range(0, 101, 20 if not layout.narrow else 50))
        axes.set_ylim(len(drawn) - 0.4, -0.6)
        axes.tick_params(axis="y", length=0)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("closed alone [% of the gap]")
        legend(figure, [axes], layout, 1)
        return figure

    signs = {standing(diagnosis, c) for c in drawn}
    words = [w for s, w in (("found", "● acts"), ("vague", "◆ may act")) if s in signs]
    left = len(known_) - len(drawn)
    best = max(drawn, key=lambda c: c.closed_fraction or 0.0)
    return Drawing(
        "bars",
        "What each candidate closes alone",
        f"Share of the gap on the held-out experiments. {', '.join(words)}"
        f"{' by the verdict. ' if words else ''}"
        f"{f'{left} more are in the table below.' if left else ''}",
        f"Bars: closed fraction of {counted(len(drawn), 'candidate')}; the most is closed by "
        f"{best.effect}, {percent(best.closed_fraction)}.",
        draw,
    )


@dataclass(frozen=True)
class SharesBar(Panels):
    """What each effect of a set contributes, as one divided bar."""

    members: Sequence[tuple[RankedCandidate, float]]

    def height(self, layout: Layout) -> float:
        """Of the bar with its legend [inches]."""
        return 1.2 + 0.18 * len(self.members) if layout.narrow else 1.25

    def draw(self, figure: Figure | SubFigure, layout: Layout) -> None:
        """Draw the bar."""
        axes = figure.subplots()
        ends = _stacked([share for _, share in self.members])
        for index, ((c, share), (begin, end)) in enumerate(zip(self.members, ends, strict=True)):
            axes.barh(
                0,
                100 * (end - begin),
                left=100 * begin,
                height=0.7,
                color=PARTS[index % len(PARTS)],
                edgecolor=PAPER,
                lw=1.5,
                label=f"{short(c.effect, LONGEST)} {percent(share)}",
            )
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
        axes.grid(visible=False)
        low = min(min(e) for e in ends)
        high = max(max(e) for e in ends)
        axes.set_xlim(100 * min(low, 0.0), 100 * max(high, 1.0))
        axes.set_xlabel("share of what the set closes [%]")
        handles, labels = axes.get_legend_handles_labels()
        columns = 1 if layout.narrow else 4
        figure.legend(handles, labels, loc="outside upper left", ncols=columns)


def shares_bar(diagnosis: Diagnosis) -> SharesBar | None:
    """The bar; None for less than two effects with a share."""
    found = [(c, c.shapley_share) for c in diagnosis.candidates if known(c.shapley_share)]
    members = [(c, share) for c, share in found if share is not None]
    return SharesBar(sorted(members, key=lambda m: -m[1])) if len(members) > 1 else None


def shares(diagnosis: Diagnosis) -> Drawing | None:
    """What each effect of a set contributes; None for less than two."""
    bar = shares_bar(diagnosis)
    if bar is None:
        return None
    words = listed(f"{c.effect} {percent(share)}" for c, share in bar.members)
    return Drawing(
        "parts",
        "What each effect contributes",
        f"Shapley shares, the mean over all orders of adding them: {words}. An effect that closes "
        "little alone may close much together with another.",
        f"A bar divided into {words}.",
        bar.alone,
    )


def _stacked(shares_: Sequence[float]) -> list[tuple[float, float]]:
    """(begin, end) of each, those below 0 to the left of it."""
    right = left = 0.0
    ends = []
    for share in shares_:
        if share >= 0:
            ends.append((right, right + share))
            right += share
        else:
            ends.append((left + share, left))
            left += share
    return ends
