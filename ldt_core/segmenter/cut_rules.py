"""Where an experiment begins and where it ends, and the rows gathered for it until it does."""

from __future__ import annotations

import abc
from collections import Counter, deque
from typing import ClassVar, NamedTuple

import numpy as np

from ldt_core.base.errors import OptionError, did_you_mean
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
    """Rows of an experiment, the row that follows, and its samples on a uniform grid."""

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
    """Gathers the rows of one experiment of so many samples.

    Complete at once when every row is on the grid; else when a row comes that lies beyond the end,
    since what lies between is needed then. Every row belongs to exactly one experiment.
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
        last = (self.samples - 1 - ROW_OF_NEXT) * self.period
        return self._split()[0] if self.rows[-1].time - self.rows[0].time >= last else None

    def _split(self) -> tuple[Cut, list[Row]]:
        end = self.rows[0].time + (self.samples - ROW_OF_NEXT) * self.period
        own = next((i for i, row in enumerate(self.rows) if row.time >= end), len(self.rows))
        own = max(own, 1)
        return Cut(self.rows[:own], self.rows[own : own + 1], self.samples), self.rows[own:]


class Rule(abc.ABC):
    """Turns rows into cuts; a pause or a jump of the clock ends what is under way."""

    name: ClassVar[str]

    def __init__(self, period: float) -> None:
        self.period = period
        #: What happened besides, by what it is.
        self.counts: Counter[str] = Counter()

    @abc.abstractmethod
    def feed(self, row: Row) -> list[Cut]:
        """The cuts that the next row completes."""

    @abc.abstractmethod
    def finish(self) -> list[Cut]:
        """No row follows without a gap: what is complete; all else is forgotten."""

    @property
    @abc.abstractmethod
    def pending(self) -> int:
        """Rows that may still become part of an experiment."""

    def _samples(self, seconds: float) -> int:
        return round(seconds / self.period)

    def _check_length(self, name: str, seconds: float) -> None:
        if self._samples(seconds) < LEAST_SAMPLES:
            expected = f"{LEAST_SAMPLES} periods of {self.period:g} s or more"
            raise OptionError(name, expected, seconds)


class LengthRule(Rule):
    """Back to back, each of the same length.

    Args:
        period: of the experiments' samples [s].
        length: of an experiment [s].
    """

    name = "length"

    def __init__(self, period: float, length: float) -> None:
        super().__init__(period)
        self._check_length("length", length)
        self.length = length
        self._collector: Collector | None = None

    def feed(self, row: Row) -> list[Cut]:
        """A cut at each full length."""
        cuts, rows = [], deque([row])
        while rows:
            now = rows.popleft()
            if self._collector is None:
                self._begin(now)
                continue
            done = self._collector.add(now)
            if done is not None:
                cut, rest = done
                cuts.append(cut)
                self._collector = None
                self._ended(cut)
                rows.extendleft(reversed(rest))
        return cuts

    def _begin(self, row: Row) -> None:
        """No experiment is under way."""
        self._collector = Collector(self._samples(self.length), self.period)
        self._collector.add(row)

    def _ended(self, cut: Cut) -> None:
        """An experiment is complete."""

    def finish(self) -> list[Cut]:
        """The last one, if nothing but a row behind it was missing."""
        cut = self._collector.finish() if self._collector else None
        self._collector = None
        return [] if cut is None else [cut]

    @property
    def pending(self) -> int:
        """Rows of the experiment under way."""
        return len(self._collector.rows) if self._collector else 0


class TriggerRule(LengthRule):
    """One experiment at each rising edge of the voltage, with what came right before it.

    An edge is a row above the level that follows one at the level or below; within an experiment it
    counts for nothing. What came before is shorter where the last experiment or a gap is nearer.

    Args:
        period: of the experiments' samples [s].
        length: from the edge on [s].
        level: of the voltage [V].
        before: what is taken along from before the edge [s].
    """

    name = "trigger"

    def __init__(self, period: float, length: float, level: float, before: float = 0.0) -> None:
        super().__init__(period, length)
        self.level, self.before = level, before
        self._history: deque[Row] = deque()
        self._last: float | None = None

    def _begin(self, row: Row) -> None:
        edge = self._last is not None and self._last <= self.level < row.voltage
        self._last = row.voltage
        self._history.append(row)
        since = row.time - self.before - GRID_TOLERANCE * self.period
        while self._history[0].time < since:
            self._history.popleft()
        if not edge:
            return
        first = self._history[0]
        samples = self._samples(row.time - first.time) + self._samples(self.length)
        self._collector = Collector(samples, self.period)
        for one in self._history:
            self._collector.add(one)
        self._history.clear()

    def _ended(self, cut: Cut) -> None:
        self._last = cut.rows[-1].voltage

    def finish(self) -> list[Cut]:
        """The last one, if nothing but a row behind it was missing."""
        self._last = None
        self._history.clear()
        return super().finish()

    @property
    def pending(self) -> int:
        """Rows of the experiment under way, or kept for the next."""
        return super().pending or len(self._history)


class SteadyRule(Rule):
    """From where the speed begins to move to where it has settled.

    The speed has settled when its range over the last `time` seconds is within `band`, as the
    settling time of a step response is defined; an experiment ends with the row that completes such
    a window. The next one begins where the window begins over which the range first exceeds the
    band again, or behind the last experiment if that is later.

    Args:
        period: of the experiments' samples [s].
        length: at which an experiment ends that has not settled; counted [s].
        band: [rad/s].
        time: of the window [s].
    """

    name = "steady"

    def __init__(self, period: float, length: float, band: float, time: float) -> None:
        super().__init__(period)
        self._check_length("steady_time", time)
        if length <= time:
            raise OptionError("length", f"more than the steady time of {time:g} s", length)
        self.length, self.band, self.time = length, band, time
        self._window: deque[Row] = deque()
        # Rows whose speed is the greatest or the least of all that follow them in the window.
        self._greatest: deque[Row] = deque()
        self._least: deque[Row] = deque()
        self._rows: list[Row] = []
        self._since = 0  # rows since the last experiment
        self._covers = False

    @property
    def statistic(self) -> float:
        """Range of the speed over the window [rad/s]."""
        return self._greatest[0].speed - self._least[0].speed if self._window else 0.0

    def feed(self, row: Row) -> list[Cut]:
        """A cut when the speed has settled, or at the greatest length."""
        self._slide(row)
        self._since += 1
        moving = self.statistic > self.band
        if self._rows:
            self._rows.append(row)
        elif moving:
            self._rows = list(self._window)[-self._since :]
        else:
            return []
        settled = self._covers and not moving
        spent = row.time - self._rows[0].time >= self.length - (1 + GRID_TOLERANCE) * self.period
        if not (settled or spent):
            return []
        self.counts["not settled within the greatest length"] += not settled
        rows, self._rows = self._rows, []
        self._since = 0
        samples = self._samples(row.time - rows[0].time) + 1
        return [Cut(rows, [], samples)] if samples >= LEAST_SAMPLES else []

    def _slide(self, row: Row) -> None:
        tolerance = GRID_TOLERANCE * self.period
        self._window.append(row)
        while self._greatest and self._greatest[-1].speed <= row.speed:
            self._greatest.pop()
        while self._least and self._least[-1].speed >= row.speed:
            self._least.pop()
        self._greatest.append(row)
        self._least.append(row)
        # The first row kept is the last one that is old enough: the window covers its time then.
        while len(self._window) > 1 and self._window[1].time <= row.time - self.time + tolerance:
            self._window.popleft()
        for extreme in (self._greatest, self._least):
            while extreme[0].time < self._window[0].time:
                extreme.popleft()
        self._covers = self._window[0].time <= row.time - self.time + tolerance

    def finish(self) -> list[Cut]:
        """Nothing: what has not settled is no experiment."""
        for rows in (self._window, self._greatest, self._least):
            rows.clear()
        self._rows, self._since = [], 0
        return []

    @property
    def pending(self) -> int:
        """Rows of the experiment under way, or kept for the next."""
        return len(self._rows) or min(len(self._window), self._since)


RULES: dict[str, type[Rule]] = {r.name: r for r in (LengthRule, TriggerRule, SteadyRule)}


def build_rule(
    name: str,
    period: float,
    length: float,
    *,
    trigger_level: float = 0.0,
    pre_trigger: float = 0.0,
    steady_band: float = 1.0,
    steady_time: float = 1.0,
) -> Rule:
    """The rule of that name; the parameters are those of `parameters.yaml`, group `cut`.

    Args:
        name: length, trigger or steady.
        period: of the experiments' samples [s].
        length: of an experiment; from the edge on; the greatest [s].
        trigger_level, pre_trigger: [V], [s].
        steady_band, steady_time: [rad/s], [s].

    Raises:
        OptionError: an unknown name, or lengths that make no experiment.
    """
    if name == LengthRule.name:
        return LengthRule(period, length)
    if name == TriggerRule.name:
        return TriggerRule(period, length, trigger_level, pre_trigger)
    if name == SteadyRule.name:
        return SteadyRule(period, length, steady_band, steady_time)
    raise OptionError("cut", did_you_mean(name, RULES), repr(name))
