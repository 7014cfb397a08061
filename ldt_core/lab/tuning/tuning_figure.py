"""The trade-off as a picture: error against adaptations, and against false alarms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ldt_core.lab.tuning.candidates import NEVER
from ldt_core.lab.tuning.choice import pareto
from ldt_core.lab.tuning.trial import Tried
from ldt_core.lab.tuning.tune import Tuning
from ldt_core.lab.tuning.tune_files import choice_sentence
from ldt_core.views.page import style
from ldt_core.views.page.style import Drawing, Layout, look

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAME = "tradeoff"
HEIGHT = 2.7  # of a row [inches]
MARGIN = 0.08  # of the range of the error, above and below it
LINEAR_ADAPTATIONS = 1.0  # adaptations up to which the axis is linear
#: False alarms in 100 experiments below which the axis is linear, to reach none.
LINEAR_FALSE_ALARMS = 1.0

Quantity = Callable[[Tried], float]
mme: Quantity = attrgetter("mme")
adaptations: Quantity = attrgetter("adaptations")


def write_figure(found: Tuning, out: Path | str) -> list[Path]:
    """Write tradeoff.png and tradeoff.svg.

    Returns:
        The files.
    """
    return style.save(drawing(found), Path(out))


def drawing(found: Tuning) -> Drawing:
    """The figure and its words; the second panel where a rate of false alarms was asked for."""
    every = found.budget.every

    def draw(layout: Layout) -> Figure:
        figure, axes = style.panels(layout, HEIGHT, columns=2, count=1 if every is None else 2)
        _tradeoff(axes[0], found)
        if every is not None:
            _false_alarms(axes[1], found, every)
        style.legend(figure, axes, layout, columns=4)
        return figure

    alt = "Mean maximum error against adaptations" + (
        "" if every is None else ", and against the rate of false alarms"
    )
    return Drawing(NAME, "The choice and what else was tried", choice_sentence(found), alt, draw)


def _rate(tried: Tried) -> float:
    """False alarms in 100 experiments: counted, or by the law where none was."""
    alarms = tried.false_alarms
    assert alarms is not None
    return 100 * (alarms.rate or alarms.law or 0.0)


def _families(found: Tuning) -> dict[str, list[Tried]]:
    """Detector → its runs in the order of the value."""
    families: dict[str, list[Tried]] = {}
    for t in found.tried:
        if t.setting != NEVER:
            families.setdefault(t.setting.detector, []).append(t)
    return families


def _tradeoff(axes: Axes, found: Tuning) -> None:
    for name, runs in _families(found).items():
        _runs(axes, found, name, runs, adaptations, mme, line=pareto(runs))
    front = pareto(found.tried)
    axes.step(
        [t.adaptations for t in front],
        [t.mme for t in front],
        where="post",
        color=style.GREEN,
        lw=5,
        alpha=0.35,
        solid_capstyle="round",
        zorder=1,
        label="least error reached",
    )
    axes.plot([0], [found.never.mme], **_point("never"))
    _mark(axes, found, adaptations, mme)
    axes.set_xlabel("adaptations")
    axes.set_title("error against adaptations (lines: best of each)")
    _error_axis(axes, found)
    allowed = found.budget.adaptations
    largest = max([t.adaptations for t in found.tried] + [allowed or 0, 1])
    _crowded(axes, LINEAR_ADAPTATIONS, 1.3 * largest)
    if allowed is not None:
        _budget(axes, allowed + 0.5)


def _false_alarms(axes: Axes, found: Tuning, every: float) -> None:
    axes.set_xlabel("false alarms in 100 experiments of the unchanged machine")
    axes.set_title("error against false alarms (bars: 95 %)")
    _error_axis(axes, found)
    _crowded(axes, min(LINEAR_FALSE_ALARMS, 100 / every), 120)
    for name, runs in _families(found).items():
        for t in runs:
            assert t.false_alarms is not None
            low, high = 100 * t.false_alarms.low, 100 * t.false_alarms.high
            axes.plot([low, high], [t.mme] * 2, color=look(name).color, lw=0.8, alpha=0.25)
        _runs(axes, found, name, runs, _rate, mme)
    _mark(axes, found, _rate, mme)
    _budget(axes, 100 / every)


def _runs(
    axes: Axes,
    found: Tuning,
    name: str,
    runs: Sequence[Tried],
    x: Quantity,
    y: Quantity,
    line: Sequence[Tried] = (),
) -> None:
    """Dots of a detector, filled where the budget is kept, and a line through some of them."""
    if line:
        points = [x(t) for t in line], [y(t) for t in line]
        axes.plot(*points, color=look(name).color, ls=look(name).line, lw=0.9)
    for kept in (True, False):
        some = [t for t in runs if found.budget.kept(t) is kept]
        face, label = (look(name).color, look(name).label) if kept else ("white", "_")
        axes.plot([x(t) for t in some], [y(t) for t in some], **_point(name), mfc=face, label=label)


def _point(name: str) -> dict[str, Any]:
    return {"color": look(name).color, "marker": look(name).marker, "ls": "none", "ms": 4.5}


def _mark(axes: Axes, found: Tuning, x: Quantity, y: Quantity) -> None:
    chosen = found.choice.chosen
    how: dict[str, Any] = {"marker": "o", "ls": "none", "mfc": "none", "mec": style.INK}
    axes.plot([], [], **{**how, "mec": style.GREY}, ms=4.5, label="beyond the budget (hollow)")
    if chosen is not None:
        label = f"the choice: {look(chosen.setting.detector).label} {chosen.setting.value:g}"
        at = [x(chosen)], [y(chosen)]
        axes.plot(*at, **how, ms=13, mew=1.6, label=label, clip_on=False, zorder=5)


def _error_axis(axes: Axes, found: Tuning) -> None:
    """The same in all panels, from the least to the largest error tried."""
    errors = [t.mme for t in found.tried]
    room = MARGIN * max(max(errors) - min(errors), 0.1 * max(errors))
    axes.set_ylim(max(0.0, min(errors) - room), max(errors) + room)
    axes.set_ylabel("mean max error [rad/s]")
    axes.axhline(found.never.mme, color=style.GREY, lw=1, ls=":", label="no learning")


def _crowded(axes: Axes, linear: float, right: float) -> None:
    """A scale from 0 on which small numbers have room as well."""
    axes.set_xscale("symlog", linthresh=linear)
    decades = range(-9, 10)
    ticks = [f * 10.0**d for d in decades for f in (1, 2, 5) if linear <= f * 10.0**d <= right]
    axes.set_xticks([0, *ticks], [f"{tick:g}" for tick in (0, *ticks)])
    axes.set_xticks([], minor=True)
    axes.set_xlim(-0.1 * linear, right)


def _budget(axes: Axes, at: float) -> None:
    right = axes.get_xlim()[1]
    axes.axvline(at, color=style.INK, lw=1, ls=(0, (2, 2)), label="budget")
    axes.axvspan(at, max(right, at), color=style.SHADE, alpha=0.6, lw=0, zorder=0)
    axes.set_xlim(right=right)
