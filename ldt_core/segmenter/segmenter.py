"""Samples in, experiments out; knows no ROS and no clock of its own."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Sequence
from statistics import median

import numpy as np
from numpy.typing import ArrayLike

from ldt_core.base.errors import OptionError, did_you_mean
from ldt_core.base.experiment import Experiment
from ldt_core.segmenter.cut_rules import Cut, Row, Rule
from ldt_core.segmenter.resampling import GAP_PERIODS, GRID_TOLERANCE

Sample = tuple[float, float]  # s, SI unit
CHANNELS = ("voltage", "speed", "current")
DEFAULT_LATENESS = 1.0  # s; two topics came 20 ms apart on a computer overloaded sevenfold
LONGEST_WAY = 10.0  # s that a message may take; a stamp that is older is of another clock
PACE_ROWS = 50  # of which the last tell how often the speed comes
MOST_ROWS = 5_000_000  # that wait or are under way; more is a stream of the wrong unit of time


class Clash(Exception):
    """What has come cannot be put together with what came before it; its text is the reason."""


class TooLate(Clash):
    """Rows have been released that would have been others, had it come in time."""


class StreamAligner:
    """Admits samples and releases rows, in the order of their times.

    A row has the voltage that was set last before its speed was measured (a voltage may be sent
    only when it changes) and the current interpolated to its time. It is released once a sample of
    its time or a later one has come of each, of the voltage also when none has come `lateness`
    later. So the rows do not depend on how the channels' messages interleave.

    Args:
        channels: voltage, speed and perhaps current.
        tolerance: difference of two times that are the same [s].
        gap: the longest pause between two samples of speed or current [s].
        lateness: by which a voltage or current may arrive later than a speed of its time [s].
    """

    def __init__(
        self, channels: tuple[str, ...], tolerance: float, gap: float, lateness: float
    ) -> None:
        self.channels = channels
        self.tolerance, self.gap, self.lateness = tolerance, gap, lateness
        self.counts: Counter[str] = Counter()
        self._samples: dict[str, deque[Sample]] = {name: deque() for name in channels}
        self._newest = dict.fromkeys(channels, -math.inf)
        self._released = -math.inf
        self._guessed = False  # the last row's voltage was held for want of news

    def admit(self, channel: str, time: float, value: float) -> bool:
        """Take a sample; False for one that cannot be used, which is counted.

        Raises:
            Clash: the clock has jumped back.
            TooLate: rows have been released with another voltage; can be admitted all the same.
        """
        newest = self._newest[channel]
        if not (math.isfinite(time) and math.isfinite(value)):
            self.counts[f"{channel} that is no finite number"] += 1
            return False
        if time < newest - self.gap:
            raise Clash(f"clock of the {channel} jumped back")
        if time <= newest:
            self.counts[f"{channel} out of order or twice"] += 1
            return False
        if channel == "voltage" and self._guessed and time <= self._released + self.tolerance:
            self._guessed = False
            raise TooLate("voltage too late")
        self._samples[channel].append((time, value))
        self._newest[channel] = time
        return True

    def clear(self) -> None:
        """Begin anew, with any clock; a voltage that is set stays set."""
        voltage = self._samples["voltage"]
        held = [(-math.inf, voltage[-1][1])] if voltage else []
        self._samples = {name: deque() for name in self.channels}
        self._samples["voltage"].extend(held)
        self._newest = dict.fromkeys(self.channels, -math.inf)
        self._released, self._guessed = -math.inf, False

    def next_row(self, hurry: bool = False) -> Row | None:
        """The next row that is complete, None when there is none; `hurry` waits for nothing to
        come.

        Raises:
            Clash: a pause of the current; the row is left out.
        """
        speeds = self._samples["speed"]
        while speeds:
            time, speed = speeds[0]
            late = hurry or self._newest["speed"] >= time + self.lateness
            if not (late or all(self._known(n, time) for n in self.channels if n != "speed")):
                return None
            speeds.popleft()
            missing = next((n for n in self.channels if not self._begun(n, time)), None)
            if missing is not None:
                self.counts[f"speed before the first {missing}"] += 1
                continue
            self._released, self._guessed = time, not self._known("voltage", time)
            current = self._interpolated("current", time) if "current" in self.channels else None
            return Row(time, self._held("voltage", time), speed, current)
        return None

    @property
    def waiting(self) -> int:
        """Speeds that wait for their voltage or current."""
        return len(self._samples["speed"])

    def _known(self, channel: str, time: float) -> bool:
        return self._newest[channel] >= time - self.tolerance

    def _begun(self, channel: str, time: float) -> bool:
        """Whether the channel has a value at a time; forgets those that are not needed then."""
        if channel == "speed":
            return True
        samples = self._samples[channel]
        while len(samples) > 1 and samples[1][0] < time - self.tolerance:
            samples.popleft()
        return bool(samples) and samples[0][0] <= time + self.tolerance

    def _held(self, channel: str, time: float) -> float:
        """The value set last; of several at that very time the first, which does not wait."""
        samples = self._samples[channel]
        if samples[0][0] < time - self.tolerance and len(samples) > 1:
            at, value = samples[1]
            if at <= time + self.tolerance:
                return value
        return samples[0][1]

    def _interpolated(self, channel: str, time: float) -> float:
        """The value on the line between the neighbours; a value of that very time as it is."""
        samples = self._samples[channel]
        for at, value in (samples[0], samples[min(1, len(samples) - 1)]):
            if abs(at - time) <= self.tolerance:
                return value
        if len(samples) == 1 or samples[1][0] - samples[0][0] > self.gap:
            raise Clash(f"pause of the {channel}")
        (begin, low), (end, high) = samples[0], samples[1]
        return low + (time - begin) / (end - begin) * (high - low)


class ArrivalClock:
    """Gives a message without a stamp the time of its arrival, on the clock of those with one.

    The stamps' clock is taken to be behind ours by as much as the quickest stamped message was:
    what took longer was under way for longer. A clock that begins anew is another one.
    """

    def __init__(self) -> None:
        self._behind: float | None = None

    def stamped(self, stamp: float, now: float) -> float:
        """Time of a message with a stamp that arrives now [s]."""
        behind, known = now - stamp, self._behind
        if known is None or behind < known or behind - known > LONGEST_WAY:
            self._behind = behind
        return stamp

    def unstamped(self, now: float) -> float:
        """Time of a message without one that arrives now [s]."""
        return now - (self._behind or 0.0)


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
    ) -> None:
        self.rule, self.period = rule, period
        self.gap = GAP_PERIODS * period if gap is None else gap
        if self.gap <= period:
            raise OptionError("longest_gap", f"more than the sample period of {period:g} s", gap)
        channels = CHANNELS if current else CHANNELS[:2]
        self._streams = StreamAligner(channels, GRID_TOLERANCE * period, self.gap, lateness)
        self._number = 1
        self._last: float | None = None
        self._steps: deque[float] = deque(maxlen=PACE_ROWS)
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

    @property
    def pace(self) -> float | None:
        """Median time between two of the last speeds [s]; None while few have come."""
        return median(self._steps) if len(self._steps) == PACE_ROWS else None

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
            if self._last is not None:
                self._steps.append(row.time - self._last)
                if self._steps[-1] > self.gap:
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
