"""Signal, Adaptation, DiagnosisRecord and AdviceRecord ↔ diagnostic_msgs/msg/DiagnosticArray.

As the contract, "Topics", has them. Numbers are written with `repr` and come back bit-equal.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from typing import Any

from ldt_core.base.errors import ExperimentError, RecordingError, did_you_mean
from ldt_core.base.experiment import (
    Action,
    Adaptation,
    AdviceRecord,
    DiagnosisRecord,
    Level,
    Scalar,
    Signal,
)
from ldt_core.recording.flat_status import FlatStatus
from ldt_core.recording.messages import Messages, quoted

OK, WARN, ERROR = 0, 1, 2  # diagnostic_msgs/msg/DiagnosticStatus
SIGNAL_LEVELS = {Level.NEGATIVE: OK, Level.WARNING: WARN, Level.POSITIVE: ERROR}
ANSWERS = {number: answer for answer, number in SIGNAL_LEVELS.items()}
# A machine whose new model was refused, or that gave a warning, deserves a look.
ACTION_LEVELS = {Action.KEPT: OK, Action.STORED: WARN, Action.ADAPTED: OK, Action.REFUSED: WARN}
SIGNAL_KEYS = ("experiment", "detector", "model_version", "max_error")
#: What is known of machine and model; older recordings have no such keys.
JUDGED_KEYS = ("state", "adequacy")
LARGEST_SIZE = 1e300  # of an error or an adequacy: sums of 10^8 such are numbers
ADAPTATION_KEYS = ("experiment", "model_version", "reason")
DIAGNOSIS_KEYS = ("experiment", "model_version", "effects")
ADVICE_KEYS = ("experiment", "model_version")
# Every cause of a gap deserves a look, the unknown one as well.
KIND_LEVELS = {"none": OK, "effect": WARN, "ambiguous": WARN, "unknown": WARN}
# Values of a diagnosis that are words as they are; all others are written as in JSON.
WORDS = ("machine", "cause", "verdict.kind", "verdict.sentence", "next_experiment.why")
# The same of an advice; `next.levels` is JSON already.
ADVICE_WORDS = (
    *("machine", "source", "left_out", "next.why", "next.name", "next.on", "next.levels"),
)
LAST_SECOND = 2**31 - 1  # builtin_interfaces/msg/Time counts seconds in 32 bits, to 2038


def encode_signal(record: Signal, make: Messages, machine: str, time: float) -> Any:
    """The DiagnosticArray of a signal; see `codec.encode`."""
    values = {
        "experiment": str(record.experiment),
        "detector": record.detector,
        "model_version": str(record.model_version),
        "max_error": repr(float(record.max_error)),
        "state": record.state,
        "adequacy": "" if record.adequacy is None else repr(float(record.adequacy)),
    }
    more = {name: repr(float(number)) for name, number in record.statistics.items()}
    where = f"signal of detector {record.detector!r}, statistics"
    level = SIGNAL_LEVELS[record.level]
    values = _joined(where, values, more)
    return _status(make, "detector", level, record.level.word, machine, time, values)


def encode_adaptation(record: Adaptation, make: Messages, machine: str, time: float) -> Any:
    """The DiagnosticArray of an adaptation; see `codec.encode`."""
    values = {**_about(record), "reason": record.reason}
    more = {name: repr(float(number)) for name, number in record.details.items()}
    level = ACTION_LEVELS[record.action]
    values = _joined("adaptation, details", values, more)
    return _status(make, "adaptor", level, str(record.action), machine, time, values)


def encode_diagnosis(record: DiagnosisRecord, make: Messages, machine: str, time: float) -> Any:
    """The DiagnosticArray of a diagnosis; see `codec.encode`."""
    more = {
        name: str(value) if name in WORDS else json.dumps(value, allow_nan=False)
        for name, value in record.values.items()
    }
    values = {**_about(record), "effects": ",".join(record.effects)}
    values = _joined(f"diagnosis of experiment {record.experiment}", values, more)
    level = KIND_LEVELS[record.kind]
    return _status(make, "diagnoser", level, record.sentence, machine, time, values)


def encode_advice(record: AdviceRecord, make: Messages, machine: str, time: float) -> Any:
    """The DiagnosticArray of an advice; see `codec.encode`."""
    more = {
        name: value
        if name in ADVICE_WORDS and isinstance(value, str)
        else json.dumps(value, allow_nan=False)
        for name, value in record.values.items()
    }
    values = _joined(f"advice at experiment {record.experiment}", _about(record), more)
    level = WARN if record.warning else OK
    return _status(make, "advisor", level, record.sentence, machine, time, values)


def _about(record: Adaptation | DiagnosisRecord | AdviceRecord) -> dict[str, str]:
    return {"experiment": str(record.experiment), "model_version": str(record.model_version)}


def _joined(where: str, values: dict[str, str], more: Mapping[str, str]) -> dict[str, str]:
    for name in more:
        if name in values:
            raise ExperimentError(where, f"names other than {', '.join(values)}", repr(name))
    return {**values, **more}


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


def stamped_ns(time: float) -> int:
    """A time [s] as a stamp says it [ns]; held at the ends of what 32 bits of seconds can say."""
    return round(min(max(time, 0.0), float(LAST_SECOND)) * 1e9)


def stamp(time: float, make: Messages) -> Any:
    """A message's time."""
    nanoseconds = stamped_ns(time)
    return make.Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def decode_signal(where: str, message: Any) -> Signal:
    """The signal in a DiagnosticArray; RecordingError when it is none."""
    level, word, values = _read_status(where, message, SIGNAL_KEYS)
    answer = ANSWERS.get(level)
    if answer is None:
        raise RecordingError(f"{where}, level", "OK (0), WARN (1) or ERROR (2)", level)
    if word != answer.word:
        expected = f"{answer.word!r} at level {level}"
        raise RecordingError(f"{where}, message", expected, quoted(word))
    return Signal(
        _whole(f"{where}, experiment", values["experiment"], 1),
        answer,
        sys.intern(values["detector"]),  # one text, however many are held
        _whole(f"{where}, model_version", values["model_version"], 0),
        _size(f"{where}, max_error", values["max_error"]),
        _numbers(values, (*SIGNAL_KEYS, *JUDGED_KEYS)),
        sys.intern(values.get("state", "")),
        _size(f"{where}, adequacy", values["adequacy"]) if values.get("adequacy") else None,
    )


def _size(where: str, text: str) -> float:
    size = _real(where, text)
    if not 0 <= size <= LARGEST_SIZE:
        raise RecordingError(where, f"0 to {LARGEST_SIZE:g}", quoted(text))
    return size


def decode_adaptation(where: str, message: Any) -> Adaptation:
    """The adaptation in a DiagnosticArray; RecordingError when it is none."""
    _, word, values = _read_status(where, message, ADAPTATION_KEYS)
    actions = [str(action) for action in Action]
    if word not in actions:
        raise RecordingError(f"{where}, message", did_you_mean(word, actions), quoted(word))
    return Adaptation(
        _whole(f"{where}, experiment", values["experiment"], 1),
        Action(word),
        _whole(f"{where}, model_version", values["model_version"], 0),
        values["reason"],
        _numbers(values, ADAPTATION_KEYS),
    )


def decode_diagnosis(where: str, message: Any) -> DiagnosisRecord:
    """The verdict in a DiagnosticArray; RecordingError when it is none."""
    _, sentence, values = _read_status(where, message, (*DIAGNOSIS_KEYS, "verdict.kind"))
    if values["verdict.kind"] not in KIND_LEVELS:
        kind = quoted(values["verdict.kind"])
        raise RecordingError(f"{where}, verdict.kind", f"one of {', '.join(KIND_LEVELS)}", kind)
    return DiagnosisRecord(
        _whole(f"{where}, experiment", values["experiment"], 1),
        _whole(f"{where}, model_version", values["model_version"], 0),
        sentence,
        tuple(name for name in values["effects"].split(",") if name),
        {k: _scalar(k, text) for k, text in values.items() if k not in DIAGNOSIS_KEYS},
    )


def decode_advice(where: str, message: Any) -> AdviceRecord:
    """The advice in a DiagnosticArray; RecordingError when it is none."""
    level, sentence, values = _read_status(where, message, ADVICE_KEYS)
    if level not in (OK, WARN):
        raise RecordingError(f"{where}, level", "OK (0) or WARN (1)", level)
    return AdviceRecord(
        _whole(f"{where}, experiment", values["experiment"], 0),
        _whole(f"{where}, model_version", values["model_version"], 0),
        level == WARN,
        sentence,
        {k: _advised(k, text) for k, text in values.items() if k not in ADVICE_KEYS},
    )


def _advised(name: str, text: str) -> Scalar:
    if name in ADVICE_WORDS:
        return None if text == "null" else text
    return _scalar(name, text)


def _scalar(name: str, text: str) -> Scalar:
    """A value of a diagnosis; what others added, and is no scalar in JSON, stays a word."""
    if name in WORDS:
        return text
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        return text
    finite = not isinstance(value, float) or math.isfinite(value)
    return value if finite and isinstance(value, Scalar) else text


def _read_status(
    where: str, message: Any, needed: tuple[str, ...]
) -> tuple[int, str, dict[str, Any]]:
    status = message if isinstance(message, FlatStatus) else _flat(where, message)
    values = dict(status.values)
    if len(values) < len(status.values):
        keys = [key for key, _ in status.values]
        again = next(key for index, key in enumerate(keys) if key in keys[:index])
        raise RecordingError(f"{where}, values", "each key once", f"{quoted(again)} twice")
    for key in needed:
        if key not in values:
            raise RecordingError(f"{where}, values", f"the key {key!r}", f"only {sorted(values)}")
    return status.level, status.message, values


def _flat(where: str, message: Any) -> FlatStatus:
    if len(message.status) != 1:
        raise RecordingError(f"{where}, status", "one status", len(message.status))
    (status,) = message.status
    level = status.level
    number = int(level[0] if isinstance(level, bytes | bytearray) else level)
    return FlatStatus(number, status.message, [(pair.key, pair.value) for pair in status.values])


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
        raise RecordingError(where, "a number", quoted(text)) from None


def _whole(where: str, text: str, least: int) -> int:
    try:
        number = int(text)
    except ValueError:
        number = least - 1
    if number < least:
        raise RecordingError(where, f"a whole number from {least}", quoted(text))
    return number
