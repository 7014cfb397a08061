"""Channels that arrive by themselves, put together at each measured speed."""

from __future__ import annotations

import math
from collections import Counter, deque

from ldt_core.segmenter.rules import Row

Sample = tuple[float, float]  # s, SI unit


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
        """The next row that is complete; None when there is none.

        Args:
            hurry: do not wait for a voltage or current that may still come.

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

    The stamps' clock is taken to be behind ours by as much as the last stamped message was.
    """

    def __init__(self) -> None:
        self._behind = 0.0

    def stamped(self, stamp: float, now: float) -> float:
        """Time of a message with a stamp that arrives now [s]."""
        self._behind = now - stamp
        return stamp

    def unstamped(self, now: float) -> float:
        """Time of a message without one that arrives now [s]."""
        return now - self._behind
