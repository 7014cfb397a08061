"""Samples in, experiments out; knows no ROS and no clock of its own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ldt_core.base.errors import OptionError, did_you_mean
from ldt_core.base.experiment import Experiment
from ldt_core.segmenter.resampling import GAP_PERIODS, GRID_TOLERANCE
from ldt_core.segmenter.rules import Cut, Rule
from ldt_core.segmenter.streams import Clash, StreamAligner, TooLate

CHANNELS = ("voltage", "speed", "current")
DEFAULT_LATENESS = 1.0  # s; two topics came 20 ms apart on a computer overloaded sevenfold
MOST_ROWS = 5_000_000  # that wait or are under way; more is a stream of the wrong unit of time


class Segmenter:
    """Cuts streams of samples into experiments of one sample period.

    | received | what happens |
    |---|---|
    | samples on the experiment's grid (within 2 % of a period) | taken as they are |
    | jitter, a stream of another rate, up to three lost samples | resampled (`resampling.py`) |
    | a pause longer than `gap` | what is under way is dropped; counted |
    | a time further back than `gap`: the clock has jumped | the same, and all begins anew |
    | a time less far back, or the same again | that sample is dropped; counted |
    | NaN or infinite | that sample is dropped; counted |
    | speed before the first voltage | dropped; counted |
    | a voltage that is older than rows already cut without it | as after a pause; counted |

    How the samples are divided into calls makes no difference; nor does how the channels
    interleave, as long as none lags by more than `lateness`.

    Args:
        rule: where experiments begin and end.
        period: of their samples [s].
        gap: the longest pause that is bridged [s]; None takes 3.5 periods.
        lateness: by which a voltage or current may arrive later than a speed of its time [s].
        current: whether there is a current.
        first: number of the first experiment.

    Raises:
        OptionError: a gap shorter than a period.
    """

    def __init__(
        self,
        rule: Rule,
        period: float,
        *,
        gap: float | None = None,
        lateness: float = DEFAULT_LATENESS,
        current: bool = False,
        first: int = 1,
    ) -> None:
        self.rule, self.period = rule, period
        self.gap = GAP_PERIODS * period if gap is None else gap
        if self.gap <= period:
            raise OptionError("longest_gap", f"more than the sample period of {period:g} s", gap)
        channels = CHANNELS if current else CHANNELS[:2]
        self._streams = StreamAligner(channels, GRID_TOLERANCE * period, self.gap, lateness)
        self._number = first
        self._last: float | None = None
        self._counts: Counter[str] = Counter()
        #: Rows that came, and rows that became part of an experiment.
        self.rows_in = self.rows_out = 0

    @property
    def counts(self) -> Counter[str]:
        """What was left out or cut short, by its reason."""
        left = Counter({"samples in no experiment": self.left_out})
        return +(self._counts + self._streams.counts + self.rule.counts + left)

    @property
    def left_out(self) -> int:
        """Rows that can no longer become part of an experiment."""
        return self.rows_in - self.rows_out - self.rule.pending

    def feed(self, channel: str, time: ArrayLike, values: ArrayLike) -> list[Experiment]:
        """Samples of one channel, one or many, in the order in which they came.

        Args:
            channel: voltage, speed or current.
            time, values: (n,) or a number [s], in SI units.

        Returns:
            The experiments that they complete.

        Raises:
            OptionError: a channel that this segmenter does not have.
        """
        if channel not in self._streams.channels:
            raise OptionError("channel", did_you_mean(channel, self._streams.channels), channel)
        done: list[Experiment] = []
        times = np.atleast_1d(np.asarray(time, dtype=float)).tolist()
        numbers = np.atleast_1d(np.asarray(values, dtype=float)).tolist()
        for at, value in zip(times, numbers, strict=True):
            done += self._one(channel, at, value)
        return done

    def catch_up(self) -> list[Experiment]:
        """Wait for no voltage that may still come: nothing has come for a while."""
        return self._released(hurry=True)

    def interrupt(self, reason: str) -> list[Experiment]:
        """End what is under way, count the reason, and begin anew with what comes next."""
        done = self._released(hurry=True) + self._stop(reason)
        self._streams.clear()
        return done

    def end(self) -> list[Experiment]:
        """No sample follows: the last experiment, if it is complete."""
        done = self._released(hurry=True) + self._made(self.rule.finish())
        self._streams.clear()
        self._last = None
        return done

    def _one(self, channel: str, time: float, value: float) -> list[Experiment]:
        try:
            admitted = self._streams.admit(channel, time, value)
        except TooLate as clash:
            self._counts[str(clash)] += 1
            self.rule.finish()  # made of rows that were wrong
            self._last = None
            self._streams.admit(channel, time, value)
            return self._released()
        except Clash as clash:
            done = self.interrupt(str(clash))
            self._streams.admit(channel, time, value)
            return done + self._released()
        if not admitted:
            return []
        done = self._released()
        if self._streams.waiting + self.rule.pending > MOST_ROWS:
            done += self.interrupt(f"more than {MOST_ROWS} samples in one experiment")
        return done

    def _released(self, hurry: bool = False) -> list[Experiment]:
        done: list[Experiment] = []
        while True:
            try:
                row = self._streams.next_row(hurry)
            except Clash as clash:
                done += self._stop(str(clash))
                continue
            if row is None:
                return done
            if self._last is not None and row.time - self._last > self.gap:
                done += self._stop("pause of the speed")
            self._last = row.time
            self.rows_in += 1
            done += self._made(self.rule.feed(row))

    def _stop(self, reason: str) -> list[Experiment]:
        self._counts[reason] += 1
        self._last = None
        return self._made(self.rule.finish())

    def _made(self, cuts: Sequence[Cut]) -> list[Experiment]:
        done = []
        for cut in cuts:
            done.append(cut.experiment(self._number, self.period))
            self._number += 1
            self.rows_out += len(cut.rows)
        return done
