"""Which drifts can be found, and which were."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ldt_core.lab.study.drift_detection import detection
from ldt_core.lab.study.evidence import Evidence
from ldt_core.lab.study.facts import Drift, energy_needed, energy_needed_knowing_the_shape
from ldt_core.lab.study.figures.dots import DASHES
from ldt_core.lab.study.figures.wear import wear
from ldt_core.views.page.style import (
    GREEN,
    INK,
    VERMILION,
    Drawing,
    Layout,
    legend,
    pair,
    panels,
    power,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Samples an experiment has when the study kept none to count.
SAMPLES = 2000
#: Shown; a drift that does less, or more, to the speed lies on the edge.
LEAST_ENERGY, MOST_ENERGY = 1e-2, 1e12


def detectable(evidence: Evidence) -> Drawing | None:
    """Energy of each drift against what wears; None without facts or runs beyond the paper."""
    best = evidence.best()
    if best is None:
        return None
    results = evidence.study.pairs("better")[best]
    points: list[tuple[Drift, bool]] = []
    for result in results:
        facts = evidence.study.facts_of(result)
        for drift in facts.drifts if facts else ():
            points.append((drift, bool(detection([drift.number], result.positives).detected)))
    if not points:
        return None
    quantity = wear(results[0])
    kept = [len(rows["time"] or ()) for r in results for rows in r.kept.values()]
    needed = energy_needed(kept[0] if kept else SAMPLES)
    visible = [found for drift, found in points if drift.detectable]
    hidden = [found for drift, found in points if not drift.detectable]

    def draw(layout: Layout) -> Figure:
        figure, (axes,) = panels(layout, 3.6)
        for found, label, color, marker in (
            (True, f"detected ({sum(f for _, f in points)})", GREEN, "o"),
            (False, f"missed ({sum(not f for _, f in points)})", VERMILION, "x"),
        ):
            chosen = [d for d, f in points if f is found]
            x = quantity.scaled([d.after for d in chosen])
            y = [min(max(d.energy, LEAST_ENERGY), MOST_ENERGY) for d in chosen]
            axes.plot(x, y, marker, color=color, mfc="none", label=label, mew=1.3)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(power)
        for value, label, dashes in (
            (needed, "detectable from here on", DASHES[1]),
            (energy_needed_knowing_the_shape(), "by its known shape", DASHES[0]),
        ):
            axes.axhline(value, color=INK, lw=1.2, ls=dashes, zorder=1, label=label)
        axes.set_xlabel(quantity.label)
        axes.set_ylabel("energy of the drift |Δy|² / σ²")
        legend(figure, [axes], layout, 4)
        return figure

    return Drawing(
        "detectable",
        "Which drifts can be found, and which were",
        f"{pair(*best)} detector: {sum(visible)} of {len(visible)} "
        f"detectable drifts detected, and {sum(hidden)} of the {len(hidden)} that one experiment "
        "of a drift does not show above the noise (by chance, or over several experiments). "
        f"Each drift stands at the value of {quantity.symbol} that it leads to.",
        "Energy of each drift on a logarithmic scale against the eccentricity after it, marked by "
        "whether it was detected, with the limit above which it is detectable.",
        draw,
    )
