"""Experiment and Prediction ↔ std_msgs/msg/Float64MultiArray (contract, "Topics")."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ldt_core.base.bounded import forget_oldest
from ldt_core.base.errors import ExperimentError
from ldt_core.base.experiment import Experiment, Prediction, Samples
from ldt_core.recording.messages import (
    LITTLE_ENDIAN,
    MULTI_ARRAY,
    Messages,
    deserialize,
    quoted,
    serialize,
    standard,
)

Made = TypeVar("Made", Experiment, Prediction)

SAMPLE = "sample"  # label of dim[0]
EXPERIMENT_HEAD = ("experiment number", "start time", "sample period")
PREDICTION_HEAD = (*EXPERIMENT_HEAD, "model version")
#: (numbers before the samples, channels that have to be there).
EXPERIMENT = EXPERIMENT_HEAD, ("voltage", "speed")
PREDICTION = PREDICTION_HEAD, ("speed",)
MOST_LAYOUTS = 64  # lengths of experiments that are remembered
DOUBLE = np.dtype("<f8")  # of the little-endian CDR that we write


def encode_samples(record: Experiment | Prediction, make: Messages) -> Any:
    """The Float64MultiArray of an experiment or a prediction."""
    head, columns = _parts(record)
    data = np.empty(len(head) + len(record) * len(columns))
    _fill(data, head, columns)
    return _message(tuple(columns), len(record), len(head), make.doubles(data), make)


def samples_cdr(record: Experiment | Prediction) -> bytes:
    """CDR bytes of that message: a tenth of the time of making and serialising it."""
    head, columns = _parts(record)
    before = _before_data(tuple(columns), len(record), len(head))
    count = len(head) + len(record) * len(columns)
    cdr = bytearray(len(before) + count * DOUBLE.itemsize)
    cdr[: len(before)] = before
    _fill(np.frombuffer(cdr, DOUBLE, count, len(before)), head, columns)
    return bytes(cdr)


@functools.lru_cache(maxsize=16)
def _before_data(labels: tuple[str, ...], length: int, offset: int) -> bytes:
    """What stands before the numbers in the CDR bytes; the same for all messages of a run."""
    count = offset + length * len(labels)
    message = _message(labels, length, offset, np.zeros(count, DOUBLE), standard())
    return serialize(message)[: -count * DOUBLE.itemsize]


def _parts(record: Experiment | Prediction) -> tuple[tuple[float, ...], dict[str, Samples]]:
    """(numbers before the samples, channel → samples)."""
    if isinstance(record, Experiment):
        columns = {"voltage": record.voltage, "speed": record.speed}
        if record.current is not None:
            columns["current"] = record.current
        return (record.number, record.start, record.period), columns
    columns = {"speed": record.speed}
    if record.speed_std is not None:
        columns["speed_std"] = record.speed_std
    return (record.number, record.start, record.period, record.model_version), columns


def _fill(data: Samples, head: Sequence[float], columns: Mapping[str, Samples]) -> None:
    data[: len(head)] = head
    body = data[len(head) :].reshape(-1, len(columns))
    for index, column in enumerate(columns.values()):
        body[:, index] = column


def _message(labels: tuple[str, ...], length: int, offset: int, data: Any, make: Messages) -> Any:
    width, size = len(labels), make.MultiArrayDimension
    return make.Float64MultiArray(
        layout=make.MultiArrayLayout(
            dim=[
                size(label=SAMPLE, size=length, stride=length * width),
                size(label=",".join(labels), size=width, stride=width),
            ],
            data_offset=offset,
        ),
        data=data,
    )


def decode_experiment(where: str, message: Any) -> Experiment:
    """The experiment in a Float64MultiArray; ExperimentError when it is none."""
    return _experiment(where, _table(where, message, *EXPERIMENT))


def decode_prediction(where: str, message: Any) -> Prediction:
    """The prediction in a Float64MultiArray; ExperimentError when it is none."""
    return _prediction(where, _table(where, message, *PREDICTION))


class _Layout(NamedTuple):
    """Bytes before the numbers of a message, and what they say."""

    before: bytes
    names: tuple[str, ...]
    length: int


class SamplesDecoder:
    """Experiments or predictions out of CDR bytes.

    Nearly all messages of a recording have the same bytes before their numbers. Those that were
    found right once need no second look, and the numbers are taken as they stand: a fifth of the
    time.

    Args:
        predictions: and not experiments.
    """

    def __init__(self, predictions: bool) -> None:
        self._wanted = PREDICTION if predictions else EXPERIMENT
        self._make = _prediction if predictions else _experiment
        self._known: dict[int, _Layout] = {}  # by the message's size

    def __call__(self, where: str, data: bytes) -> Experiment | Prediction:
        """The record in CDR bytes.

        Raises:
            RecordingError: no such message.
            ExperimentError: no such record.
        """
        head, _ = self._wanted
        known = self._known.get(len(data))
        if known is not None and data.startswith(known.before):
            numbers = np.frombuffer(data, DOUBLE, offset=len(known.before))
            parsed = _parsed(where, numbers, head, known.names, known.length)
            return self._make(where, parsed)
        message = deserialize(data, MULTI_ARRAY, where)
        names, length = _layout(where, message, *self._wanted)
        numbers = np.asarray(message.data, dtype=np.float64)
        record = self._make(where, _parsed(where, numbers, head, names, length))
        begin = len(data) - numbers.size * DOUBLE.itemsize
        if data[1:2] == LITTLE_ENDIAN and numbers.tobytes() == data[begin:]:
            self._known[len(data)] = _Layout(data[:begin], names, length)
            forget_oldest(self._known, MOST_LAYOUTS)
        return record


def _experiment(where: str, parsed: tuple[list[Any], dict[str, Samples]]) -> Experiment:
    head, columns = parsed
    return _checked(
        where,
        lambda: Experiment(*head, columns["voltage"], columns["speed"], columns.get("current")),  # type: ignore[call-arg]
    )


def _prediction(where: str, parsed: tuple[list[Any], dict[str, Samples]]) -> Prediction:
    head, columns = parsed
    return _checked(where, lambda: Prediction(*head, columns["speed"], columns.get("speed_std")))  # type: ignore[call-arg]


def _checked(where: str, make: Callable[[], Made]) -> Made:
    try:
        return make()
    except ExperimentError as error:
        raise ExperimentError(f"{where}, {error.where}", error.expected, error.got) from None


def _table(
    where: str, message: Any, head: tuple[str, ...], needed: tuple[str, ...]
) -> tuple[list[Any], dict[str, Samples]]:
    """(numbers before the samples, channel → samples); channels in any order, more than needed."""
    names, length = _layout(where, message, head, needed)
    return _parsed(where, np.asarray(message.data, dtype=np.float64), head, names, length)


def _layout(
    where: str, message: Any, head: tuple[str, ...], needed: tuple[str, ...]
) -> tuple[tuple[str, ...], int]:
    """(channels, samples)."""
    dims = message.layout.dim
    if len(dims) != 2:
        raise ExperimentError(f"{where}, layout.dim", "two dimensions", len(dims))
    rows, channels = dims
    _equal(f"{where}, layout.dim[0].label", SAMPLE, rows.label)
    names = [name.strip() for name in str(channels.label).split(",")]
    for name in needed:
        if names.count(name) == 0:
            label = f"the channels {','.join(needed)}, separated by commas"
            raise ExperimentError(f"{where}, layout.dim[1].label", label, quoted(channels.label))
    if len(set(names)) < len(names):
        raise ExperimentError(
            f"{where}, layout.dim[1].label", "each channel once", quoted(channels.label)
        )
    length, width, offset = int(rows.size), len(names), len(head)
    if length < 1:
        raise ExperimentError(f"{where}, layout.dim[0].size", "one sample or more", length)
    _equal(f"{where}, layout.dim[1].size", width, channels.size)
    _equal(f"{where}, layout.dim[1].stride", width, channels.stride)
    _equal(f"{where}, layout.dim[0].stride", length * width, rows.stride)
    _equal(f"{where}, layout.data_offset", offset, message.layout.data_offset)
    return tuple(names), length


def _parsed(
    where: str, data: Samples, head: tuple[str, ...], names: tuple[str, ...], length: int
) -> tuple[list[Any], dict[str, Samples]]:
    width, offset = len(names), len(head)
    if data.shape != (offset + length * width,):
        raise ExperimentError(
            f"{where}, data",
            f"{offset} + {length} x {width} = {offset + length * width} numbers",
            data.size,
        )
    numbers = data[:offset].tolist()
    for name, number in zip(head, numbers, strict=True):
        if not math.isfinite(number):
            raise ExperimentError(f"{where}, {name}", "a finite number", number)
    body = data[offset:].reshape(length, width)
    return numbers, {name: body[:, index] for index, name in enumerate(names)}


def _equal(where: str, expected: Any, got: Any) -> None:
    if got != expected:
        raise ExperimentError(where, repr(expected), quoted(got))
