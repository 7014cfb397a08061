"""Samples as `sensor_msgs/JointState`, of which stock tools draw curves; none is recorded in a run.

`joint_states` has up to three joints: the machine as measured, `predicted` by the twin, and by the
`original` model; a place before a known one is NaN where it is not known. `voltage` and `current`
are efforts, as of a machine that streams its samples (`ldt up --stream`).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ldt_core.recording.messages import typestore
from ldt_core.recording.status_messages import stamped_ns
from ldt_core.views.export.predicted_runs import PredictedRun

KIND = "sensor_msgs/msg/JointState"
SECOND = 10**9  # ns
#: Stand in for numbers while a message's layout is asked for; no two of their bytes are alike.
STAMP = (0x01020304, 0x05060708)
MARKS = tuple(struct.unpack("<d", bytes(range(16 * k + 1, 16 * k + 9)))[0] for k in (1, 2, 3))


class SampleMessage(NamedTuple):
    """A message, ready to be written.

    Args:
        topic: last part of its name.
        time_ns: of the sample [ns since the epoch].
        data: CDR bytes.
    """

    topic: str
    time_ns: int
    data: bytes


class _Template:
    """Messages that differ by their stamp and numbers alone; encoding each would take 30 µs.

    Args:
        names: of the joints.
        effort: whether the numbers are efforts, not velocities.
    """

    def __init__(self, machine: str, names: list[str], effort: bool) -> None:
        types = typestore(KIND)
        stamp = types.types["builtin_interfaces/msg/Time"](*STAMP)
        header = types.types["std_msgs/msg/Header"](stamp, machine)
        none, some = np.zeros(0), np.array(MARKS[: len(names)])
        velocities, efforts = (none, some) if effort else (some, none)
        message = types.types[KIND](header, names, none, velocities, efforts)
        self._bytes = bytes(types.serialize_cdr(message, KIND))
        self._stamp = self._bytes.index(struct.pack("<iI", *STAMP))
        self._numbers = self._bytes.index(struct.pack("<d", MARKS[0]))
        self._count = len(names)

    def fill(self, time_ns: int, numbers: bytes) -> bytes:
        made = bytearray(self._bytes)
        struct.pack_into("<iI", made, self._stamp, *divmod(time_ns, SECOND))
        made[self._numbers : self._numbers + 8 * self._count] = numbers
        return bytes(made)


def sample_messages(
    run: PredictedRun, machine: str, streamed: bool = False
) -> Iterator[SampleMessage]:
    """All samples of an experiment, in the order of their times.

    Args:
        run: the experiment and its predictions.
        machine: its name.
        streamed: whether the measured speed was sent already, sample by sample.
    """
    e, curves = run.experiment, run.curves()
    lacking = np.full(len(e), np.nan)
    known = [None if streamed else e.speed, *map(curves.get, ("predicted_speed", "original_speed"))]
    while known and known[-1] is None:
        known.pop()
    parts = []
    if known:  # layouts name a joint by its place
        rows = np.column_stack([lacking if c is None else c for c in known]).astype("<f8")
        names = [machine or "machine", "predicted", "original"][: len(known)]
        parts.append(("joint_states", _Template(machine, names, False), rows))
    for name in ("voltage", "current"):
        if name in curves:
            values = np.ascontiguousarray(curves[name], dtype="<f8").reshape(-1, 1)
            parts.append((name, _Template(machine, [machine or "machine"], True), values))
    first = stamped_ns(e.start)
    for k in range(len(e)):
        time_ns = min(first + round(k * e.period * SECOND), stamped_ns(math.inf))
        for topic, template, values in parts:
            yield SampleMessage(topic, time_ns, template.fill(time_ns, values[k].tobytes()))


def speed_message(machine: str, moment: float, speed: float) -> SampleMessage:
    """A sample that a machine streams: its stamp [s since the epoch], its speed [rad/s]."""
    time_ns = stamped_ns(moment)
    template = _Template(machine, [machine or "machine"], False)
    return SampleMessage("joint_states", time_ns, template.fill(time_ns, struct.pack("<d", speed)))
