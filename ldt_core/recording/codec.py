"""The records of the twin ↔ the messages of the contract ("Topics").

Attribute access only, so that the same functions work on real ROS messages, on those that
`rosbags` or `mcap-ros2-support` decode, and on our own. Decoding checks everything, since all of it
comes from outside. Floats in texts are written with `repr` and come back bit-equal.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ldt_core.base.errors import RecordingError, did_you_mean
from ldt_core.base.experiment import (
    Adaptation,
    AdviceRecord,
    DiagnosisRecord,
    Experiment,
    ModelRecord,
    Prediction,
    Signal,
)
from ldt_core.recording.experiment_messages import (
    SamplesDecoder,
    decode_experiment,
    decode_prediction,
    encode_samples,
    samples_cdr,
)
from ldt_core.recording.flat_status import flat_status
from ldt_core.recording.messages import (
    DIAGNOSTICS,
    MULTI_ARRAY,
    STRING,
    Messages,
    deserialize,
    serialize,
    standard,
)
from ldt_core.recording.model_json import model_text, parse_model
from ldt_core.recording.status_messages import (
    decode_adaptation,
    decode_advice,
    decode_diagnosis,
    decode_signal,
    encode_adaptation,
    encode_advice,
    encode_diagnosis,
    encode_signal,
)

Record = (
    Experiment | Prediction | Signal | ModelRecord | Adaptation | DiagnosisRecord | AdviceRecord
)


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
        case Experiment() | Prediction():
            return encode_samples(record, make)
        case Signal():
            return encode_signal(record, make, machine, time)
        case ModelRecord():
            return make.String(data=model_text(record))
        case Adaptation():
            return encode_adaptation(record, make, machine, time)
        case DiagnosisRecord():
            return encode_diagnosis(record, make, machine, time)
        case AdviceRecord():
            return encode_advice(record, make, machine, time)
    raise TypeError(f"no message for {type(record).__name__}")


def encode_cdr(record: Record, machine: str = "", time: float = 0.0) -> bytes:
    """The CDR bytes of a record's message; arguments and errors as in `encode`."""
    if isinstance(record, Experiment | Prediction):
        return samples_cdr(record)
    return serialize(encode(record, machine=machine, time=time))


def decode(topic: str, message: Any, where: str | None = None) -> Record:
    """The record in a message.

    Args:
        topic: its topic; the last part decides what it is.
        message: any object with the message's attributes.
        where: what to call it in messages for people; None for the topic.

    Raises:
        ExperimentError: samples, numbers or layout that are no experiment or prediction.
        ModelError: a text that is no model record.
        RecordingError: a topic without records, or a status that is no signal, adaptation,
            diagnosis or advice.
    """
    name = topic.rpartition("/")[2]
    if name not in DECODERS:
        raise RecordingError(topic, f"a topic with records: {did_you_mean(name, DECODERS)}", name)
    return DECODERS[name][1](where or topic, message)


def decode_cdr(topic: str, kind: str, data: bytes, where: str | None = None) -> Record:
    """The record in CDR bytes, as `decode` of their message, in a fraction of the time.

    Args:
        topic: its last part decides what it is.
        kind: message type.
        data: CDR bytes.
        where: what to call it in messages for people; None for the topic.

    Raises:
        RecordingError: a topic without records, or bytes that are no such message.
        ExperimentError, ModelError, RecordingError: as `decode`.
    """
    name, place = topic.rpartition("/")[2], where or topic
    if name in DECODERS and DECODERS[name][0] == kind:
        if kind == MULTI_ARRAY:
            return _SAMPLES[name](place, data)
        if kind == DIAGNOSTICS and (status := flat_status(data)) is not None:
            return DECODERS[name][1](place, status)
    return decode(topic, deserialize(data, kind, place), where)


def _decode_model(where: str, message: Any) -> ModelRecord:
    return parse_model(where, message.data)


#: Topic (last part) → (message type, decoder of it).
DECODERS: dict[str, tuple[str, Callable[[str, Any], Record]]] = {
    "experiment": (MULTI_ARRAY, decode_experiment),
    "prediction": (MULTI_ARRAY, decode_prediction),
    "original_prediction": (MULTI_ARRAY, decode_prediction),
    "signal": (DIAGNOSTICS, decode_signal),
    "adaptation": (DIAGNOSTICS, decode_adaptation),
    "diagnosis": (DIAGNOSTICS, decode_diagnosis),
    "advice": (DIAGNOSTICS, decode_advice),
    "model": (STRING, _decode_model),
}

_SAMPLES = {
    name: SamplesDecoder(predictions=decoder is decode_prediction)
    for name, (kind, decoder) in DECODERS.items()
    if kind == MULTI_ARRAY
}
