"""What a serializer leaves between fields makes no other message."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.records import Schema
from mcap.well_known import MessageEncoding, SchemaEncoding

from ldt_core.base.experiment import (
    Action,
    Adaptation,
    Experiment,
    Level,
    ModelRecord,
    Prediction,
    Signal,
)
from ldt_core.recording.codec import DECODERS, encode_cdr
from ldt_core.recording.duplicate_filter import DuplicateFilter
from ldt_core.recording.message_subject import number_of
from ldt_core.recording.messages import HEAD, content, deserialize, schema

DecoderFactory = pytest.importorskip("mcap_ros2.decoder").DecoderFactory

REST = np.zeros(5)
RECORDS = {
    "experiment": Experiment(7, 1e9, 0.01, REST + 5, REST, REST + 1),
    "prediction": Prediction(7, 1e9, 0.01, 2, REST, REST + 0.1),
    "signal": Signal(7, Level.WARNING, "threshold", 0, 1.5, {"threshold": 3.0}),
    "adaptation": Adaptation(7, Action.STORED, 0, "a warning", {"warning_set": 1.0}),
    "model": ModelRecord(3, "linear", (7,), {"a": [0.5], "b": [0.1], "c": 0.0}),
}


def said(topic, data):
    """What another reader makes of a message; None where it cannot read it."""
    kind = DECODERS[topic][0]
    try:
        deserialize(data, kind, "here")  # that reader does without the zero that ends a text
        return plain(reader(kind)(data))
    except Exception:
        return None


@functools.cache
def reader(kind):
    """Of the messages of a type."""
    text, _ = schema(kind)
    described = Schema(id=1, name=kind, encoding=SchemaEncoding.ROS2, data=text.encode())
    return DecoderFactory().decoder_for(MessageEncoding.CDR, described)


def plain(value):
    """A decoded message as text, numbers to the last bit."""
    if isinstance(value, list):
        return [plain(v) for v in value]
    fields = getattr(value, "__slots__", None)
    return {f: plain(getattr(value, f)) for f in fields} if fields else repr(value)


def padding(topic, data):
    """Places of bytes that make no difference to that reader."""
    found = []
    for at in range(HEAD, len(data)):
        other = bytearray(data)
        other[at] ^= 0xAA
        if said(topic, bytes(other)) == said(topic, data):
            found.append(at)
    return found


@pytest.fixture(scope="module", params=RECORDS)
def message(request):
    data = encode_cdr(RECORDS[request.param], "rotor", 1e9)
    return request.param, data, padding(request.param, data)


def test_what_is_between_fields_does_not_count(message):
    """Bytes that an earlier message left in the buffer, as Fast CDR sends them."""
    topic, data, places = message
    assert places or topic == "model"
    kind, dirty = DECODERS[topic][0], bytearray(data)
    for at in places:
        dirty[at] = 0x65
    assert content(kind, bytes(dirty)) == content(kind, data)
    assert number_of(topic, kind, bytes(dirty)) == number_of(topic, kind, data)
    assert number_of(topic, kind, data) == (None if topic == "model" else 7)
    repeats = DuplicateFilter()
    assert not repeats.seen(f"/{topic}", kind, data)
    assert repeats.seen(f"/{topic}", kind, bytes(dirty) + b"\0\0")


def test_every_other_byte_counts(message):
    """One bit of it changed is another message."""
    topic, data, places = message
    kind = DECODERS[topic][0]
    for at in set(range(HEAD, len(data))) - set(places):
        other = bytearray(data)
        other[at] ^= 1
        assert content(kind, bytes(other)) != content(kind, data), at


@given(st.sampled_from(sorted(RECORDS)), st.binary(max_size=200))
def test_any_bytes_have_a_content(topic, data):
    """Never an error, and the content of that is itself."""
    kind = DECODERS[topic][0]
    found = content(kind, data)
    assert content(kind, data[:HEAD] + found) == found


def test_a_message_that_is_cut_is_taken_as_it_is():
    """At every place: never an error, and no two of them alike but for padding at the end."""
    for topic, record in RECORDS.items():
        data, kind = encode_cdr(record, "rotor", 1e9), DECODERS[topic][0]
        for at in range(len(data)):
            assert content(kind, data[:at]) == data[HEAD:at].rstrip(b"\0") or said(topic, data[:at])
