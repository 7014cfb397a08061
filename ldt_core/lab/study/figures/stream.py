"""The stream of experiments: what one looks like, and how the machine wears (figures 4, 5)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ldt_core.lab.study.drift_detection import drifts_of
from ldt_core.lab.study.figures.reading import Reading
from ldt_core.lab.study.figures.series import first_seed, of_seed, wear
from ldt_core.views.page.style import GREY, INK, VERMILION, Drawing, Layout, look, panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def input_output(reading: Reading) -> Drawing | None:
    """Voltage and speed of one experiment; None where the study kept none."""
    study = reading.study
    kept = [(r, n) for r in study.results() for n in sorted(r.kept)]
    if not kept:
        return None
    result, number = kept[0]
    rows = result.kept[number]
    time, voltage, speed = (np.array(rows[n]) for n in ("time", "voltage", "speed"))
    quantity = wear(result)
    worn = quantity.text(result.truth[result.number.index(number)])

    def draw(layout: Layout) -> Figure:
        figure, (upper, lower) = panels(layout, 1.9, columns=1, count=2, sharex=True)
        upper.step(time, voltage, where="post", color=INK, lw=1.2)
        upper.set_ylabel("voltage $V_s$ [V]", parse_math=True)
        lower.plot(time, speed, **look("measured").plot(lw=1.2))
        lower.set_ylabel("speed ω [rad/s]")
        lower.set_xlabel("time [s]")
        lower.set_xlim(time[0], time[-1])
        figure.align_ylabels()
        return figure

    return Drawing(
        "input_output",
        "Input and output of an experiment",
        f"Experiment {number} of seed {result.case.seed}, {worn}: a random voltage between "
        f"{voltage.min():.1f} and {voltage.max():.1f} V in, the speed of the motor out "
        f"(at most {speed.max():.1f} rad/s).",
        "Two curves over time: a stepped voltage, and the speed that follows it.",
        draw,
    )


def staircase(reading: Reading) -> Drawing | None:
    """What wears, over the stream; None without runs."""
    study = reading.study
    results = study.results("paper") or study.results("better") or study.results()
    if not results:
        return None
    seed = first_seed(results)
    shown = of_seed(results, seed)[0]
    others = list({r.case.seed: r for r in results if r.case.seed != seed}.values())
    quantity = wear(shown)
    drifts = drifts_of(shown.truth, shown.number[0])

    def draw(layout: Layout) -> Figure:
        figure, (axes,) = panels(layout, 2.8)
        for index, other in enumerate(others):
            count = f"{len(others)} seeds" if len(others) > 1 else "seed"
            label = f"the other {count}" if index == 0 else None
            values = quantity.scaled(other.truth)
            axes.step(other.number, values, where="post", color=GREY, alpha=0.45, lw=1, label=label)
        values = quantity.scaled(shown.truth)
        axes.step(shown.number, values, where="post", color=VERMILION, label=f"seed {seed}", lw=2)
        axes.set_xlabel("experiment")
        axes.set_ylabel(quantity.label)
        axes.set_xlim(shown.number[0], shown.number[-1])
        axes.set_ylim(bottom=0)
        axes.legend(loc="upper left")
        return figure

    held = np.diff([shown.number[0], *drifts, shown.number[-1] + 1])
    return Drawing(
        "staircase",
        "How the machine wears over the stream",
        f"{quantity.name} rises from {quantity.text(min(shown.truth))} to "
        f"{quantity.text(max(shown.truth))} in {len(drifts)} drifts; each level is held for "
        f"{held.min()} to {held.max()} experiments (seed {seed}). The twin never sees it.",
        f"A staircase over {len(shown.number)} experiments, with steps of random length.",
        draw,
    )
