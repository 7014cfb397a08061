"""What is left on each stream of the group robustness, beside the references."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ldt_core.lab.statistics import geometric_mean
from ldt_core.lab.study.claims.robust_aims import Scored, scored
from ldt_core.lab.study.robustness.robust_run import DEFAULT, SETUPS, STRAW_MAN
from ldt_core.lab.study.study import Evidence
from ldt_core.views.page.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    PAPER,
    PURPLE,
    Drawing,
    Layout,
    legend,
    panels,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROW, FRAME = 0.22, 1.6  # inches: of a stream, and of legend and labels
#: Setup → marker, its face, its edge.
MARKS = {
    DEFAULT: ("D", GREEN, GREEN),
    STRAW_MAN: ("v", PAPER, GREY),
    "paper, hybrid": ("o", PAPER, BLUE),
    "paper, linear": ("s", PAPER, PURPLE),
}
#: Per cent, where the axis ends: what nobody learned from leaves 100.
ENDS = (1.0, 200.0)


def robustness(evidence: Evidence) -> Drawing | None:
    """Left of the original's error on each stream; None without the group."""
    runs = evidence.study.robust
    by_setup = {setup: scored(runs, setup) for setup in SETUPS}
    default = by_setup[DEFAULT]
    if not default:
        return None

    def draw(layout: Layout) -> Figure:
        return _draw(layout, by_setup)

    every = [score.left for entries in default.values() for _, score in entries]
    return Drawing(
        "robust_streams",
        "What is left of the original's error on streams of every kind",
        f"The default leaves {100 * min(every):.0f} to {100 * max(every):.0f} %. Geometric means "
        "over the seeds; the bar is late, which knows the truth one experiment late.",
        "Rows of marks, one for each stream: mean maximum error in per cent of the original's, of "
        "the default, of the paper's two configurations, of a simple detector, and of the "
        "reference late.",
        draw,
    )


def _draw(layout: Layout, by_setup: dict[str, Scored]) -> Figure:
    names = list(by_setup[DEFAULT])
    places = {name: place for place, name in enumerate(names)}
    figure, (axes,) = panels(layout, FRAME + ROW * len(names))
    late = {n: [s.late_left for _, s in runs] for n, runs in by_setup[DEFAULT].items()}
    shown = [_shown(values) for values in late.values()]
    axes.plot(shown, list(places.values()), "|", color=INK, ms=9, mew=2, label="late")
    for setup in reversed(MARKS):
        found = by_setup[setup]
        shown = [_shown([s.left for _, s in found[n]]) for n in found if n in places]
        marker, face, edge = MARKS[setup]
        axes.plot(
            shown,
            [places[n] for n in found if n in places],
            marker,
            mfc=face,
            mec=edge,
            ms=5,
            label=setup,
        )
    axes.axvline(100, color=INK, lw=0.8)
    axes.set_xscale("log")
    axes.set_xlim(*ENDS)
    axes.set_xticks([1, 3, 10, 30, 100], ["1", "3", "10", "30", "100"])
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(left=False)
    axes.set_xlabel("left of the original's mean maximum error [%]")
    legend(figure, [axes], layout)
    return figure


def _shown(shares: list[float]) -> float:
    """Geometric mean [%], at the axis' end where it lies beyond."""
    value = geometric_mean(shares).value
    return min(max(100 * (value or 0.0), ENDS[0]), ENDS[1])
