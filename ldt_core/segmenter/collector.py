"""The rows of one experiment of known length, gathered until it is complete."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ldt_core.base.experiment import Experiment
from ldt_core.segmenter.resampling import GRID_TOLERANCE, Series, fits_grid, resample

LEAST_SAMPLES = 2  # of an experiment: one sample has no dynamics
ROW_OF_NEXT = 0.5  # of a period: a row nearer to the end than this belongs to what follows


class Row(NamedTuple):
    """All channels at one measured speed: time [s], voltage [V], speed [rad/s], current [A]."""

    time: float
    voltage: float
    speed: float
    current: float | None = None


class Cut(NamedTuple):
    """Rows that make an experiment.

    Args:
        rows: its own, the first at its start.
        after: the row that follows, for what lies between the two.
        samples: of the experiment on its uniform grid.
    """

    rows: list[Row]
    after: list[Row]
    samples: int

    def experiment(self, number: int, period: float) -> Experiment:
        """On the grid that begins with the first row: as measured where the rows are on it."""
        rows = self.rows + self.after
        time = np.array([row.time for row in rows])
        columns = {"voltage": [r.voltage for r in rows], "speed": [r.speed for r in rows]}
        if rows[0].current is not None:
            columns["current"] = [r.current for r in rows]  # type: ignore[misc]
        own = time[: len(self.rows)]
        if own.size == self.samples and fits_grid(own, period):
            values = {name: np.array(column[: own.size]) for name, column in columns.items()}
        else:
            grid = time[0] + period * np.arange(self.samples)
            values = {
                name: resample(Series(time, np.array(column), str), grid, period, name == "voltage")
                for name, column in columns.items()
            }
        return Experiment(number, rows[0].time, period, **values)


class Collector:
    """Gathers rows from the first one on.

    Complete at once when every row is on the grid; else when a row comes that lies beyond the end,
    since what lies between is needed then. Every row belongs to exactly one experiment.

    Args:
        samples: of the experiment.
        period: [s].
    """

    def __init__(self, samples: int, period: float) -> None:
        self.samples, self.period = samples, period
        self.rows: list[Row] = []
        self._on_grid = True

    def add(self, row: Row) -> tuple[Cut, list[Row]] | None:
        """The experiment, if this row completes it, and the rows that it does not own."""
        self.rows.append(row)
        index = len(self.rows) - 1
        past = row.time - self.rows[0].time
        tolerance = GRID_TOLERANCE * self.period
        self._on_grid = self._on_grid and abs(past - index * self.period) <= tolerance
        if self._on_grid and len(self.rows) == self.samples:
            return Cut(self.rows, [], self.samples), []
        if past >= self.samples * self.period - tolerance:
            return self._split()
        return None

    def finish(self) -> Cut | None:
        """The experiment, if the rows reach its last sample although none comes behind it."""
        if not self.rows:
            return None
        last = (self.samples - 1 - GRID_TOLERANCE) * self.period
        return self._split()[0] if self.rows[-1].time - self.rows[0].time >= last else None

    def _split(self) -> tuple[Cut, list[Row]]:
        end = self.rows[0].time + (self.samples - ROW_OF_NEXT) * self.period
        own = next((i for i, row in enumerate(self.rows) if row.time >= end), len(self.rows))
        own = max(own, 1)
        return Cut(self.rows[:own], self.rows[own : own + 1], self.samples), self.rows[own:]
