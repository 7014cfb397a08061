"""An experiment's samples, one message each, for those who expect a stream."""

from __future__ import annotations

import math
from collections.abc import Callable

from builtin_interfaces.msg import Time
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState

from ldt_core.base.experiment import Experiment

#: Samples in 5 ms at most, 2000 a second: a listener in Python keeps up with that.
BURST = 10


class SampleStream:
    """Publishes the samples of one experiment after the other, as far as they are due."""

    def __init__(self, publish: Callable[[str], Publisher], joint: str) -> None:
        self.joint = joint
        self._speed = publish("joint_states")
        self._drive = {"voltage": publish("voltage"), "current": publish("current")}
        self._experiment: Experiment | None = None
        self._next = 0

    def load(self, experiment: Experiment | None) -> None:
        """The experiment that is streamed from now on."""
        self._experiment, self._next = experiment, 0

    @property
    def done(self) -> bool:
        """Whether all its samples are out."""
        return self._experiment is None or self._next >= len(self._experiment)

    def advance(self, now: float | None = None) -> None:
        """Publish what is due.

        Args:
            now: time of the machine [s since the epoch]; None for a burst, whatever the time.
        """
        one = self._experiment
        if one is None:
            return
        end = min(len(one), self._next + BURST)
        while self._next < end:
            at = one.start + self._next * one.period
            if now is not None and at > now:
                return
            self._send(one, self._next, at)
            self._next += 1

    def _send(self, one: Experiment, index: int, at: float) -> None:
        # The voltage first: a listener knows what drives the joint when its speed comes.
        for name, values in (("voltage", one.voltage), ("current", one.current)):
            if values is not None:
                message = JointState(name=[self.joint], effort=[float(values[index])])
                message.header.stamp = exact_stamp(at)
                self._drive[name].publish(message)
        message = JointState(name=[self.joint], velocity=[float(one.speed[index])])
        message.header.stamp = exact_stamp(at)
        self._speed.publish(message)


def exact_stamp(time: float) -> Time:
    """A time in seconds as a stamp, to half a nanosecond: the number comes back from it."""
    whole = math.floor(time)
    nanoseconds = round((time - whole) * 1e9)
    return Time(sec=whole + nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
