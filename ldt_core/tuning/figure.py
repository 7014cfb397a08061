"""The trade-off as a picture: error against adaptations, false alarms, and thresholds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import msgs_config
from ldt_core.study.figures import style
from ldt_core.study.figures.style import Drawing, Layout, look
from ldt_core.tuning.choice import pareto
from ldt_core.tuning.procedure import Tuning
from ldt_core.tuning.setting import NEVER
from ldt_core.tuning.trial import Tried
from ldt_core.tuning.words import sentence

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAME = "tradeoff"
HEIGHT = 2.7  # of a row [inches]
HEADROOM = 1.06


def write_figure(found: Tuning, out: Path | str) -> list[Path]:
    """Write tradeoff.png and tradeoff.svg.

    Returns:
        The files.
    """
    return style.save(drawing(found), Path(out))


def drawing(found: Tuning) -> Drawing:
    """The figure and its words."""

    def draw(layout: Layout) -> Figure:
        figure, axes = style.panels(layout, HEIGHT, columns=2, count=6)
        _tradeoff(axes[0], found)
        _false_alarms(axes[1], found)
        for column, unit in enumerate(("rad/s", "experiments")):
            _against(axes[2 + column], found, unit, "MME [rad/s]", lambda t: t.mme)
            _against(axes[4 + column], found, unit, "adaptations", lambda t: t.adaptations)
        for letter, one in zip("abcdef", axes, strict=True):
            one.set_title(f"({letter}) {one.get_title(loc='left')}")
        style.legend(figure, axes, layout, columns=4)
        return figure

    alt = (
        "Six panels: mean maximum error against adaptations and against the rate of false alarms, "
        "then error and adaptations against the limit and against the rarity of each detector."
    )
    return Drawing(NAME, "The choice and what else was tried", sentence(found), alt, draw)


def _families(found: Tuning) -> dict[str, list[Tried]]:
    """Detector → its runs in the order of the value."""
    families: dict[str, list[Tried]] = {}
    for t in found.tried:
        if t.setting != NEVER:
            families.setdefault(t.setting.detector, []).append(t)
    return families


def _tradeoff(axes: Axes, found: Tuning) -> None:
    budget = found.budget.adaptations
    for name, runs in _families(found).items():
        line = sorted(runs, key=lambda t: (t.adaptations, t.mme))
        _line(axes, found, name, line, [float(t.adaptations) for t in line])
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
        label="Pareto front",
    )
    axes.plot([0], [found.never.mme], **_point("never"))
    _mark(axes, found, lambda t: float(t.adaptations))
    _frame(axes, found, "adaptations", "error against adaptations")
    axes.set_xlim(left=-0.5)
    if budget is not None:
        axes.set_xlim(right=max(axes.get_xlim()[1], budget + 1.0))
        _budget(axes, budget + 0.5)


def _false_alarms(axes: Axes, found: Tuning) -> None:
    """Bars are intervals; a rate by a law stands at the law where the interval is wider."""
    _frame(axes, found, "false alarms in 100 experiments in control", "error against false alarms")
    if found.control is None:
        axes.text(0.5, 0.5, "no experiments in control are known", ha="center", va="center",
                  transform=axes.transAxes)  # fmt: skip
        return
    for name, runs in _families(found).items():
        rates = [t.false_alarms.rate * 100 for t in runs if t.false_alarms]
        lows = [t.false_alarms.low * 100 for t in runs if t.false_alarms]
        highs = [t.false_alarms.high * 100 for t in runs if t.false_alarms]
        errors = [t.mme for t in runs if t.false_alarms]
        axes.hlines(errors, lows, highs, color=look(name).color, lw=0.8, alpha=0.45)
        _dots(axes, found, name, runs, rates)
    _mark(axes, found, lambda t: t.false_alarms.rate * 100 if t.false_alarms else None)
    axes.set_xlim(left=-1)
    if found.budget.every is not None:
        _budget(axes, 100 / found.budget.every)


def _against(
    axes: Axes, found: Tuning, unit: str, quantity: str, of: Callable[[Tried], float]
) -> None:
    declared = msgs_config.parameters("detector")
    labels = []
    for name, runs in _families(found).items():
        line = [t for t in runs if declared.get(t.setting.parameter, {}).get("unit") == unit]
        if unit == "experiments":
            line += [t for t in runs if t.setting.parameter == "window"]
        if not line:
            continue
        labels.append(f"{line[0].setting.parameter} ({look(name).label})")
        _line(axes, found, name, line, [t.setting.value for t in line], of)
    chosen = found.choice.chosen
    shown = chosen is not None and f"{chosen.setting.parameter} (" in " ".join(labels)
    if shown:
        _mark(axes, found, lambda t: t.setting.value, of)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(style.power)
    axes.set_xlabel(f"{', '.join(labels) or 'not tried'} [{unit}]")
    axes.set_ylabel(quantity)
    axes.set_ylim(bottom=0)
    mme = quantity.startswith("MME")
    axes.set_title(f"{'error' if mme else 'adaptations'} against the setting")
    if mme:
        _never_line(axes, found)
    elif found.budget.adaptations is not None:
        axes.axhline(found.budget.adaptations, color=style.INK, lw=1, ls=(0, (2, 2)))


def _line(
    axes: Axes,
    found: Tuning,
    name: str,
    runs: Sequence[Tried],
    x: Sequence[float],
    of: Callable[[Tried], float] = lambda t: t.mme,
) -> None:
    axes.plot(x, [of(t) for t in runs], color=look(name).color, ls=look(name).line, lw=0.9)
    _dots(axes, found, name, runs, x, of)


def _dots(
    axes: Axes,
    found: Tuning,
    name: str,
    runs: Sequence[Tried],
    x: Sequence[float],
    of: Callable[[Tried], float] = lambda t: t.mme,
) -> None:
    """Filled where the budget is kept."""
    for kept in (True, False):
        points = [(a, of(t)) for a, t in zip(x, runs, strict=True) if found.budget.kept(t) is kept]
        face = look(name).color if kept else "white"
        label = look(name).label if kept else "_"
        axes.plot(*(zip(*points, strict=True) if points else ([], [])), **_point(name),
                  mfc=face, label=label)  # fmt: skip


def _point(name: str) -> dict[str, object]:
    return {"color": look(name).color, "marker": look(name).marker, "ls": "none", "ms": 4.5}


def _mark(
    axes: Axes,
    found: Tuning,
    x: Callable[[Tried], float | None],
    y: Callable[[Tried], float] = lambda t: t.mme,
) -> None:
    chosen = found.choice.chosen
    if chosen is None or (at := x(chosen)) is None:
        return
    axes.plot([at], [y(chosen)], "o", ms=13, mfc="none", mec=style.INK, mew=1.6, label="the choice",
              clip_on=False, zorder=5)  # fmt: skip


def _frame(axes: Axes, found: Tuning, x: str, title: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel("MME [rad/s]")
    top = max(t.mme for t in found.tried)
    low = min(t.mme for t in found.tried)
    room = max(top - low, 0.05 * top) * 0.12
    axes.set_ylim(max(0.0, low - room), top + room)
    axes.set_title(title)
    _never_line(axes, found)


def _never_line(axes: Axes, found: Tuning) -> None:
    axes.axhline(found.never.mme, color=style.GREY, lw=1, ls=":", label="no learning")


def _budget(axes: Axes, at: float) -> None:
    right = axes.get_xlim()[1]
    axes.axvline(at, color=style.INK, lw=1, ls=(0, (2, 2)), label="budget")
    axes.axvspan(at, max(right, at), color=style.SHADE, alpha=0.6, lw=0, zorder=0)
    axes.set_xlim(right=right)
