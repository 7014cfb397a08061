"""Samples as `sensor_msgs/JointState`, of which stock tools draw curves; none is recorded in a run.

`joint_states` has three joints: the machine as measured, `predicted` by the twin and by the
`original` model, where there are such. `voltage` and `current` are efforts, as of a machine that
streams its samples (`ldt up --stream`).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ldt_core.recording.messages import typestore
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


def sample_messages(run: PredictedRun, machine: str) -> Iterator[SampleMessage]:
    """All samples of an experiment, in the order of their times."""
    e, curves = run.experiment, run.curves()
    joints = {machine or "machine": "speed", "predicted": "predicted_speed"}
    joints["original"] = "original_speed"
    there = {name: curve for name, curve in joints.items() if curve in curves}
    rows = np.column_stack([curves[c] for c in there.values()]).astype("<f8")
    parts = [("joint_states", _Template(machine, list(there), False), rows)]
    for name in ("voltage", "current"):
        if name in curves:
            values = np.ascontiguousarray(curves[name], dtype="<f8").reshape(-1, 1)
            parts.append((name, _Template(machine, [machine or "machine"], True), values))
    first = round(e.start * SECOND)
    for k in range(len(e)):
        time_ns = first + round(k * e.period * SECOND)
        for topic, template, values in parts:
            yield SampleMessage(topic, time_ns, template.fill(time_ns, values[k].tobytes()))
