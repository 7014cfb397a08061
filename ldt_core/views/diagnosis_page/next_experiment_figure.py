"""The experiment that would settle what is open, as a figure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ldt_core.diagnosis.diagnosis import NextExperiment
from ldt_core.views.diagnosis_page.number_format import value_of
from ldt_core.views.diagnosis_page.signal_curves import Array
from ldt_core.views.packed_samples import thinned
from ldt_core.views.page.style import BLUE, Drawing, Layout, panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def voltage(following: NextExperiment) -> Drawing:
    """Its voltage over time."""
    volts = np.asarray(following.voltage, dtype=np.float64)
    period = following.sample_period
    duration = volts.size * period
    time, level = corners(volts, period)

    def draw(layout: Layout) -> Figure:
        figure, (axes,) = panels(layout, 1.8)
        axes.plot(*thinned(time, level), color=BLUE, lw=1.4)
        axes.set_xlim(0, duration)
        axes.set_xlabel("time [s]")
        axes.set_ylabel("voltage [V]")
        return figure

    words = (
        f"{value_of(duration)} s between {value_of(float(volts.min()))} and "
        f"{value_of(float(volts.max()))} V"
    )
    return Drawing(
        "voltage",
        "Voltage of the next experiment",
        f"{words[0].upper()}{words[1:]}; each sample held for {period:g} s.",
        f"The voltage over time, {words}.",
        draw,
    )


def corners(volts: Array, period: float) -> tuple[Array, Array]:
    """(time [s], voltage [V]) of the corners of a row of held levels."""
    switch = np.flatnonzero(np.diff(volts)) + 1
    begin = np.concatenate([[0], switch]) * period
    end = np.concatenate([switch, [volts.size]]) * period
    level = volts[np.concatenate([[0], switch])]
    return np.column_stack([begin, end]).ravel(), np.repeat(level, 2)
