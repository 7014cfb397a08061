"""The records of the twin ↔ the messages of the contract ("Topics").

Attribute access only, so that the same functions work on real ROS messages, on those that
`rosbags` or `mcap-ros2-support` decode, and on our own. Decoding checks everything, since all of it
comes from outside. Floats in texts are written with `repr` and come back bit-equal.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ldt_core.errors import ExperimentError, ModelError, RecordingError, did_you_mean
from ldt_core.experiment import (
    Action,
    Adaptation,
    Experiment,
    Level,
    ModelRecord,
    Prediction,
    Samples,
    Signal,
)
from ldt_core.recording.messages import DIAGNOSTICS, MULTI_ARRAY, STRING, Messages, standard

Record = Experiment | Prediction | Signal | ModelRecord | Adaptation

SAMPLE = "sample"  # label of dim[0]
EXPERIMENT_HEAD = ("experiment number", "start time", "sample period")
PREDICTION_HEAD = (*EXPERIMENT_HEAD, "model version")
OK, WARN, ERROR = 0, 1, 2  # diagnostic_msgs/msg/DiagnosticStatus
SIGNAL_LEVELS = {Level.NEGATIVE: OK, Level.WARNING: WARN, Level.POSITIVE: ERROR}
# A machine whose model was refused, or that gave a warning, deserves a look.
ACTION_LEVELS = {Action.KEPT: OK, Action.STORED: WARN, Action.ADAPTED: OK, Action.REFUSED: WARN}
SIGNAL_KEYS = ("experiment", "detector", "model_version", "max_error")
ADAPTATION_KEYS = ("experiment", "model_version", "reason")
LAST_SECOND = 2**31 - 1  # builtin_interfaces/msg/Time counts seconds in 32 bits, to 2038
MAX_JSON = 100_000_000  # characters; a Gaussian process of 2000 inducing points takes 2 million
SHOWN = 60  # characters of a foreign text that a sentence quotes


def encode(
    record: Record, messages: Messages | None = None, machine: str = "", time: float = 0.0
) -> Any:
    """The message of a record.

    Args:
        record: what to send or store.
        messages: constructors to build from; None for those of a recording without ROS.
        machine: name of the machine, the `hardware_id` of a status.
        time: time of the statement [s since the epoch], the stamp of a status.

    Raises:
        ExperimentError: a statistic or detail with a name that the message has in use.
    """
    make = messages or standard()
    match record:
        case Experiment():
            return _encode_experiment(record, make)
        case Prediction():
            return _encode_prediction(record, make)
        case Signal():
            return _encode_signal(record, make, machine, time)
        case ModelRecord():
            return make.String(data=_model_json(record))
        case Adaptation():
            return _encode_adaptation(record, make, machine, time)
    raise TypeError(f"no message for {type(record).__name__}")


def decode(topic: str, message: Any, where: str | None = None) -> Record:
    """The record in a message.

    Args:
        topic: its topic; the last part decides what it is.
        message: any object with the message's attributes.
        where: what to call it in messages for people; None for the topic.

    Raises:
        ExperimentError: samples, numbers or layout that are no experiment or prediction.
        ModelError: a text that is no model record.
        RecordingError: a topic without records, or a status that is no signal or adaptation.
    """
    name = topic.rpartition("/")[2]
    if name not in DECODERS:
        raise RecordingError(topic, f"a topic with records: {did_you_mean(name, DECODERS)}", name)
    return DECODERS[name][1](where or topic, message)


def _encode_experiment(record: Experiment, make: Messages) -> Any:
    columns = {"voltage": record.voltage, "speed": record.speed}
    if record.current is not None:
        columns["current"] = record.current
    return _array((record.number, record.start, record.period), columns, make)


def _encode_prediction(record: Prediction, make: Messages) -> Any:
    columns = {"speed": record.speed}
    if record.speed_std is not None:
        columns["speed_std"] = record.speed_std
    head = (record.number, record.start, record.period, record.model_version)
    return _array(head, columns, make)


def _array(head: Sequence[float], columns: Mapping[str, Samples], make: Messages) -> Any:
    width, length = len(columns), len(next(iter(columns.values())))
    data = np.empty(len(head) + length * width)
    data[: len(head)] = head
    body = data[len(head) :].reshape(length, width)
    for index, column in enumerate(columns.values()):
        body[:, index] = column
    size = make.MultiArrayDimension
    return make.Float64MultiArray(
        layout=make.MultiArrayLayout(
            dim=[
                size(label=SAMPLE, size=length, stride=length * width),
                size(label=",".join(columns), size=width, stride=width),
            ],
            data_offset=len(head),
        ),
        data=make.doubles(data),
    )


def _decode_experiment(where: str, message: Any) -> Experiment:
    head, columns = _table(where, message, EXPERIMENT_HEAD, ("voltage", "speed"))
    return _checked(
        where,
        lambda: Experiment(*head, columns["voltage"], columns["speed"], columns.get("current")),
    )


def _decode_prediction(where: str, message: Any) -> Prediction:
    head, columns = _table(where, message, PREDICTION_HEAD, ("speed",))
    return _checked(where, lambda: Prediction(*head, columns["speed"], columns.get("speed_std")))


def _checked(where: str, make: Callable[[], Any]) -> Any:
    try:
        return make()
    except ExperimentError as error:
        raise ExperimentError(f"{where}, {error.where}", error.expected, error.got) from None


def _table(
    where: str, message: Any, head: tuple[str, ...], needed: tuple[str, ...]
) -> tuple[list[float], dict[str, Samples]]:
    """(numbers before the samples, channel → samples); channels in any order, more than needed."""
    dims = message.layout.dim
    if len(dims) != 2:
        raise ExperimentError(f"{where}, layout.dim", "two dimensions", len(dims))
    rows, channels = dims
    _equal(f"{where}, layout.dim[0].label", SAMPLE, rows.label)
    names = [name.strip() for name in str(channels.label).split(",")]
    for name in needed:
        if names.count(name) == 0:
            label = f"the channels {','.join(needed)}, separated by commas"
            raise ExperimentError(f"{where}, layout.dim[1].label", label, _quoted(channels.label))
    if len(set(names)) < len(names):
        raise ExperimentError(
            f"{where}, layout.dim[1].label", "each channel once", _quoted(channels.label)
        )
    length, width, offset = int(rows.size), len(names), len(head)
    if length < 1:
        raise ExperimentError(f"{where}, layout.dim[0].size", "one sample or more", length)
    _equal(f"{where}, layout.dim[1].size", width, channels.size)
    _equal(f"{where}, layout.dim[1].stride", width, channels.stride)
    _equal(f"{where}, layout.dim[0].stride", length * width, rows.stride)
    _equal(f"{where}, layout.data_offset", offset, message.layout.data_offset)
    data = np.asarray(message.data, dtype=np.float64)
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
        raise ExperimentError(where, repr(expected), _quoted(got))


def _encode_signal(record: Signal, make: Messages, machine: str, time: float) -> Any:
    values = {
        "experiment": str(record.experiment),
        "detector": record.detector,
        "model_version": str(record.model_version),
        "max_error": repr(float(record.max_error)),
    }
    where = f"signal of detector {record.detector!r}, statistics"
    _add(where, values, record.statistics)
    level = SIGNAL_LEVELS[record.level]
    return _status(make, "detector", level, record.level.word, machine, time, values)


def _encode_adaptation(record: Adaptation, make: Messages, machine: str, time: float) -> Any:
    values = {
        "experiment": str(record.experiment),
        "model_version": str(record.model_version),
        "reason": record.reason,
    }
    _add("adaptation, details", values, record.details)
    level = ACTION_LEVELS[record.action]
    return _status(make, "adaptor", level, str(record.action), machine, time, values)


def _add(where: str, values: dict[str, str], numbers: Mapping[str, float]) -> None:
    for name, number in numbers.items():
        if name in values:
            raise ExperimentError(where, f"names other than {', '.join(values)}", repr(name))
        values[name] = repr(float(number))


def _status(
    make: Messages,
    name: str,
    level: int,
    word: str,
    machine: str,
    time: float,
    values: Mapping[str, str],
) -> Any:
    return make.DiagnosticArray(
        header=make.Header(stamp=stamp(time, make), frame_id=""),
        status=[
            make.DiagnosticStatus(
                level=make.level(level),
                name=name,
                message=word,
                hardware_id=machine,
                values=[make.KeyValue(key=k, value=v) for k, v in values.items()],
            )
        ],
    )


def stamp(time: float, make: Messages) -> Any:
    """A message's time; held at the ends of what 32 bits of seconds can say."""
    nanoseconds = round(min(max(time, 0.0), float(LAST_SECOND)) * 1e9)
    return make.Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def _decode_signal(where: str, message: Any) -> Signal:
    level, word, values = _read_status(where, message, SIGNAL_KEYS)
    answers = {number: answer for answer, number in SIGNAL_LEVELS.items()}
    if level not in answers:
        raise RecordingError(f"{where}, level", "OK (0), WARN (1) or ERROR (2)", level)
    if word != answers[level].word:
        raise RecordingError(
            f"{where}, message", f"{answers[level].word!r} at level {level}", _quoted(word)
        )
    max_error = _real(f"{where}, max_error", values["max_error"])
    if not (math.isfinite(max_error) and max_error >= 0):
        raise RecordingError(f"{where}, max_error", "0 or more", values["max_error"])
    return Signal(
        _whole(f"{where}, experiment", values["experiment"], 1),
        answers[level],
        values["detector"],
        _whole(f"{where}, model_version", values["model_version"], 0),
        max_error,
        _numbers(values, SIGNAL_KEYS),
    )


def _decode_adaptation(where: str, message: Any) -> Adaptation:
    _, word, values = _read_status(where, message, ADAPTATION_KEYS)
    actions = [str(action) for action in Action]
    if word not in actions:
        raise RecordingError(f"{where}, message", did_you_mean(word, actions), _quoted(word))
    return Adaptation(
        _whole(f"{where}, experiment", values["experiment"], 1),
        Action(word),
        _whole(f"{where}, model_version", values["model_version"], 0),
        values["reason"],
        _numbers(values, ADAPTATION_KEYS),
    )


def _read_status(where: str, message: Any, needed: tuple[str, ...]) -> tuple[int, str, dict]:
    if len(message.status) != 1:
        raise RecordingError(f"{where}, status", "one status", len(message.status))
    status = message.status[0]
    values: dict[str, str] = {}
    for pair in status.values:
        if pair.key in values:
            raise RecordingError(f"{where}, values", "each key once", f"{_quoted(pair.key)} twice")
        values[pair.key] = pair.value
    for key in needed:
        if key not in values:
            raise RecordingError(f"{where}, values", f"the key {key!r}", f"only {sorted(values)}")
    level = status.level
    return int(level[0] if isinstance(level, bytes | bytearray) else level), status.message, values


def _numbers(values: Mapping[str, str], known: tuple[str, ...]) -> dict[str, float]:
    """The numbers among the further values; texts that others added are theirs."""
    numbers = {}
    for key, text in values.items():
        if key not in known:
            try:
                numbers[key] = float(text)
            except ValueError:
                continue
    return numbers


def _real(where: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise RecordingError(where, "a number", _quoted(text)) from None


def _whole(where: str, text: str, least: int) -> int:
    try:
        number = int(text)
    except ValueError:
        number = least - 1
    if number < least:
        raise RecordingError(where, f"a whole number from {least}", _quoted(text))
    return number


def _model_json(record: ModelRecord) -> str:
    data = {
        "version": record.version,
        "kind": record.kind,
        "trained_on": list(record.trained_on),
        "parameters": dict(record.parameters),
    }
    return json.dumps(data, allow_nan=False)


def _decode_model(where: str, message: Any) -> ModelRecord:
    text = message.data
    if len(text) > MAX_JSON:
        raise ModelError(where, f"at most {MAX_JSON} characters", len(text))
    try:
        data = json.loads(text, parse_float=_finite, parse_constant=_finite)
    except (ValueError, RecursionError) as error:
        raise ModelError(where, "a model record in JSON", error) from None
    if not isinstance(data, dict):
        raise ModelError(where, "a JSON object", _quoted(text))
    for key, kind in (("version", int), ("kind", str), ("trained_on", list), ("parameters", dict)):
        if key not in data:
            raise ModelError(where, f"the key {key!r}", f"only {sorted(data)}")
        if not isinstance(data[key], kind) or isinstance(data[key], bool):
            raise ModelError(f"{where}, {key}", _JSON_WORDS[kind], _quoted(data[key]))
    numbers = data["trained_on"]
    if data["version"] < 0:
        raise ModelError(f"{where}, version", "0 or more", data["version"])
    if not all(type(n) is int and n >= 1 for n in numbers):
        raise ModelError(f"{where}, trained_on", "experiment numbers from 1", _quoted(numbers))
    return ModelRecord(data["version"], data["kind"], tuple(numbers), data["parameters"])


_JSON_WORDS = {int: "a whole number", str: "a word", list: "a list", dict: "names with values"}


def _finite(text: str) -> float:
    number = float(text.replace("Infinity", "inf"))
    if not math.isfinite(number):
        raise ValueError(f"{text} is no finite number")
    return number


def _quoted(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= SHOWN else text[: SHOWN - 3] + "..."


#: Topic (last part) → (message type, decoder of it).
DECODERS: dict[str, tuple[str, Callable[[str, Any], Record]]] = {
    "experiment": (MULTI_ARRAY, _decode_experiment),
    "prediction": (MULTI_ARRAY, _decode_prediction),
    "original_prediction": (MULTI_ARRAY, _decode_prediction),
    "signal": (DIAGNOSTICS, _decode_signal),
    "adaptation": (DIAGNOSTICS, _decode_adaptation),
    "model": (STRING, _decode_model),
}

__all__ = ["DECODERS", "Record", "decode", "encode", "stamp"]
