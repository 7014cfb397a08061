"""Claims about records and their messages: round trips are bit-exact, nonsense is refused."""

from __future__ import annotations

import array
import contextlib
import importlib
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ldt_core.base.errors import BadInput, ExperimentError, ModelError, RecordingError
from ldt_core.base.experiment import (
    Action,
    Adaptation,
    DiagnosisRecord,
    Experiment,
    Level,
    ModelRecord,
    Prediction,
    Signal,
)
from ldt_core.recording import codec
from ldt_core.recording.messages import Messages, deserialize, serialize, standard

finite = st.floats(allow_nan=False, allow_infinity=False)
words = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)
names = words.filter(lambda w: w not in ("experiment", "detector", "model_version", "max_error"))
names = names.filter(lambda w: w not in ("reason", "state", "adequacy"))
numbers = st.dictionaries(names, st.floats(allow_nan=False), max_size=4)
counts = st.integers(1, 2**53 - 1)


@st.composite
def rows(draw, columns: int):
    length = draw(st.integers(1, 20))
    return [draw(st.lists(finite, min_size=length, max_size=length)) for _ in range(columns)]


@st.composite
def experiments(draw):
    voltage, speed, current = draw(rows(3))
    return Experiment(
        draw(counts),
        draw(finite),
        draw(st.floats(1e-9, 1e9)),
        voltage,
        speed,
        draw(st.sampled_from([None, current])),
    )


@st.composite
def predictions(draw):
    speed, std = draw(rows(2))
    return Prediction(
        draw(counts),
        draw(finite),
        draw(st.floats(1e-9, 1e9)),
        draw(st.integers(0, 2**53 - 1)),
        speed,
        draw(st.sampled_from([None, np.abs(std)])),
    )


signals = st.builds(
    Signal, counts, st.sampled_from(Level), words, counts, st.floats(0, 1e300), numbers
)
adaptations = st.builds(Adaptation, counts, st.sampled_from(Action), counts, words, numbers)
scalars = st.none() | st.booleans() | st.integers() | finite | words
kinds = st.sampled_from(["none", "effect", "ambiguous", "unknown"])


def diagnosis(experiment, version, sentence, effects, kind, values):
    told = {**values, "verdict.kind": kind, "verdict.sentence": sentence}
    return DiagnosisRecord(experiment, version, sentence, tuple(effects), told)


diagnoses = st.builds(
    diagnosis,
    *(counts, counts, words),
    st.lists(st.sampled_from(["unbalance", "input_delay"]), max_size=2),
    kinds,
    st.dictionaries(names.filter(lambda w: w != "effects"), scalars, max_size=4),
)
plain = st.recursive(
    st.none() | st.booleans() | st.integers() | finite | words,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=3),
    max_leaves=10,
)
models = st.builds(
    ModelRecord,
    st.integers(0, 10**9),
    words,
    st.lists(counts, max_size=4).map(tuple),
    st.dictionaries(words, plain, max_size=4),
)
RECORDS = {
    "experiment": experiments(),
    "prediction": predictions(),
    "original_prediction": predictions(),
    "signal": signals,
    "adaptation": adaptations,
    "diagnosis": diagnoses,
    "model": models,
}


def same(a, b) -> bool:
    """Bit-equality of two records; distinguishes -0.0 from 0.0."""
    first, second = vars(a), vars(b)
    return type(a) is type(b) and all(_bits(first[k]) == _bits(second[k]) for k in first)


def _bits(value):
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if isinstance(value, float):
        return np.float64(value).tobytes()
    if isinstance(value, dict):
        return {k: _bits(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_bits(v) for v in value]
    return type(value), value


def ros_messages() -> Messages:
    """The constructors that a node passes: real ROS classes."""
    std = pytest.importorskip("std_msgs.msg")
    diagnostic = importlib.import_module("diagnostic_msgs.msg")
    return Messages(
        Float64MultiArray=std.Float64MultiArray,
        MultiArrayLayout=std.MultiArrayLayout,
        MultiArrayDimension=std.MultiArrayDimension,
        String=std.String,
        Header=std.Header,
        Time=importlib.import_module("builtin_interfaces.msg").Time,
        DiagnosticArray=diagnostic.DiagnosticArray,
        DiagnosticStatus=diagnostic.DiagnosticStatus,
        KeyValue=diagnostic.KeyValue,
        level=lambda number: bytes([number]),
        doubles=lambda row: array.array("d", row.tobytes()),
    )


def example(number: int = 3, length: int = 4) -> Experiment:
    ramp = np.arange(length) / 8
    return Experiment(number, 1.7e9, 0.01, ramp, ramp + 1)


@pytest.mark.slow
@pytest.mark.parametrize("topic", RECORDS)
def test_every_record_comes_back_bit_equal_through_message_and_bytes(topic):
    """Encode → CDR → decode is the identity, for all records."""

    @settings(max_examples=60)
    @given(RECORDS[topic])
    def check(record):
        message = codec.encode(record, machine="rotor", time=12.5)
        kind = codec.DECODERS[topic][0]
        assert same(codec.decode(topic, deserialize(serialize(message), kind, topic)), record)

    check()


# rosidl's parser, behind every rclpy serialisation, imports an old lark that imports sre_parse.
@pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")
@pytest.mark.parametrize("topic", RECORDS)
def test_real_ros_messages_carry_the_same_records(topic, monkeypatch):
    """The same functions fill and read rclpy's classes, with their field checks on."""
    monkeypatch.setenv("ROS_PYTHON_CHECK_FIELDS", "1")
    make = ros_messages()
    serialization = pytest.importorskip("rclpy.serialization")

    @settings(max_examples=20)
    @given(RECORDS[topic])
    def check(record):
        message = codec.encode(record, make, machine="rotor", time=12.5)
        assert same(codec.decode(f"/machine_1/{topic}", message), record)
        data = serialization.serialize_message(message)
        kind = codec.DECODERS[topic][0]
        assert same(codec.decode(topic, deserialize(data, kind, topic)), record)
        ours = bytes(serialize(codec.encode(record, machine="rotor", time=12.5)))
        back = serialization.deserialize_message(ours, type(message))
        assert same(codec.decode(topic, back), record)

    check()


def test_an_experiment_has_the_layout_of_the_contract():
    """dim, strides, offset, the three numbers in front, row-major samples."""
    message = codec.encode(Experiment(7, 100.0, 0.5, [1, 2], [3, 4], [5, 6]))
    rows, channels = message.layout.dim
    assert (rows.label, rows.size, rows.stride) == ("sample", 2, 6)
    assert (channels.label, channels.size, channels.stride) == ("voltage,speed,current", 3, 3)
    assert message.layout.data_offset == 3
    assert list(message.data) == [7, 100, 0.5, 1, 3, 5, 2, 4, 6]


def test_a_prediction_carries_its_model_version_in_front():
    """data_offset 4: number, start, period, model version."""
    message = codec.encode(Prediction(7, 100.0, 0.5, 9, [3, 4], [0.1, 0.2]))
    assert message.layout.data_offset == 4
    assert message.layout.dim[1].label == "speed,speed_std"
    assert list(message.data) == [7, 100, 0.5, 9, 3, 0.1, 4, 0.2]


@pytest.mark.parametrize(
    ("level", "number"), [(Level.NEGATIVE, 0), (Level.WARNING, 1), (Level.POSITIVE, 2)]
)
def test_a_signal_is_one_status_for_stock_tools(level, number):
    """Level, word, name, machine and at least the values of the contract."""
    message = codec.encode(
        Signal(5, level, "lddm", 2, 0.1, {"rate": 1 / 3}), machine="rotor", time=1.5
    )
    (status,) = message.status
    assert (status.level, status.message) == (number, level.word)
    assert (status.name, status.hardware_id) == ("detector", "rotor")
    values = {pair.key: pair.value for pair in status.values}
    assert values == {
        "experiment": "5",
        "detector": "lddm",
        "model_version": "2",
        "max_error": "0.1",
        "state": "",
        "adequacy": "",
        "rate": repr(1 / 3),
    }
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)


def test_a_stamp_beyond_2038_is_held_at_the_last_second():
    """32 bits of seconds end; the message is written all the same, the record keeps its time."""
    message = codec.encode(Signal(1, Level.WARNING, "x", 0, 0.0), time=1e11)
    assert message.header.stamp.sec == 2**31 - 1
    serialize(message)


def test_channels_may_come_in_any_order_and_with_others_between():
    """Only names count; what we do not know is left alone."""
    message = codec.encode(example(length=2))
    message.layout.dim[1].label = "temperature,speed,voltage"
    message.layout.dim[1].size = message.layout.dim[1].stride = 3
    message.layout.dim[0].stride = 6
    message.data = np.array([3, 0, 0.01, np.nan, 1, 2, np.nan, 3, 4])
    experiment = codec.decode("experiment", message)
    assert experiment.speed.tolist() == [1, 3]
    assert experiment.voltage.tolist() == [2, 4]


def _set(path, value):
    def change(message):
        *way, last = path.split(".")
        target = message
        for part in way:
            target = target[int(part)] if part.isdigit() else getattr(target, part)
        if last.isdigit():
            target[int(last)] = value
        else:
            setattr(target, last, value)

    return change


def _data(index, value):
    def change(message):
        message.data = message.data.copy()
        message.data[index] = value

    return change


# what is changed → what the sentence must name
BROKEN_EXPERIMENTS = {
    "rows mislabelled": (_set("layout.dim.0.label", "samples"), "layout.dim[0].label"),
    "one dimension": (_set("layout.dim", []), "layout.dim"),
    "no speed": (_set("layout.dim.1.label", "voltage,Speed"), "voltage,speed"),
    "speed twice": (_set("layout.dim.1.label", "voltage,speed,speed"), "each channel once"),
    "wrong size": (_set("layout.dim.0.size", 5), "layout.dim[0].stride"),
    "size 0": (_set("layout.dim.0.size", 0), "one sample"),
    "absurd size": (_set("layout.dim.0.size", 2**32 - 1), "layout.dim[0].stride"),
    "wrong width": (_set("layout.dim.1.size", 3), "layout.dim[1].size"),
    "wrong stride": (_set("layout.dim.1.stride", 1), "layout.dim[1].stride"),
    "wrong offset": (_set("layout.data_offset", 0), "layout.data_offset"),
    "too short": (_set("data", np.zeros(10)), "11 numbers"),
    "too long": (_set("data", np.zeros(12)), "11 numbers"),
    "no data": (_set("data", np.zeros(0)), "11 numbers"),
    "nan": (_data(4, np.nan), "speed"),
    "infinite": (_data(5, np.inf), "voltage"),
    "number 0": (_data(0, 0.0), "number"),
    "number 1.5": (_data(0, 1.5), "number"),
    "number nan": (_data(0, np.nan), "number"),
    "number infinite": (_data(0, np.inf), "number"),
    "start infinite": (_data(1, -np.inf), "start time"),
    "period 0": (_data(2, 0.0), "sample period"),
    "period negative": (_data(2, -0.1), "sample period"),
}


@pytest.mark.parametrize("fault", BROKEN_EXPERIMENTS)
def test_a_broken_experiment_is_refused_in_a_sentence(fault):
    """Each wrong field is named, with the topic, what was expected and what came."""
    change, named = BROKEN_EXPERIMENTS[fault]
    message = codec.encode(example())
    change(message)
    with pytest.raises(ExperimentError) as caught:
        codec.decode("experiment", message, where="/machine_1/experiment")
    assert str(caught.value).startswith("/machine_1/experiment")
    assert named in str(caught.value)
    assert "\n" not in str(caught.value)


BROKEN_SIGNALS = {
    "no status": (_set("status", []), "one status"),
    "stale": (_set("status.0.level", 3), "level"),
    "level as a byte": (_set("status.0.level", b"\x07"), "level"),
    "other word": (_set("status.0.message", "negative"), "'positive'"),
    "key missing": (_set("status.0.values.3.key", "maxerror"), "max_error"),
    "key twice": (_set("status.0.values.3.key", "detector"), "each key once"),
    "experiment 0": (_set("status.0.values.0.value", "0"), "experiment"),
    "experiment a word": (_set("status.0.values.0.value", "first"), "'first'"),
    "experiment endless": (_set("status.0.values.0.value", "9" * 5000), "experiment"),
    "error negative": (_set("status.0.values.3.value", "-1"), "max_error"),
    "error nan": (_set("status.0.values.3.value", "nan"), "max_error"),
    "error beyond sums": (_set("status.0.values.3.value", "1e308"), "max_error"),
    "adequacy nan": (_set("status.0.values.5.value", "nan"), "adequacy"),
    "adequacy beyond sums": (_set("status.0.values.5.value", "1e308"), "adequacy"),
    "error a word": (_set("status.0.values.3.value", "large"), "'large'"),
}


@pytest.mark.parametrize("fault", BROKEN_SIGNALS)
def test_a_broken_signal_is_refused_in_a_sentence(fault):
    """As for experiments; the sentence stays short whatever came."""
    change, named = BROKEN_SIGNALS[fault]
    message = codec.encode(Signal(5, Level.POSITIVE, "lddm", 2, 0.1))
    change(message)
    with pytest.raises(RecordingError) as caught:
        codec.decode("signal", message)
    assert named in str(caught.value)
    assert len(str(caught.value)) < 300


def test_an_unknown_action_is_refused():
    """`adaptation` knows four words."""
    message = codec.encode(Adaptation(1, Action.KEPT, 0, "fine"))
    message.status[0].message = "keep"
    with pytest.raises(RecordingError, match="did you mean 'kept'"):
        codec.decode("adaptation", message)


def named(**values):
    told = {"verdict.kind": "effect", "gap.closed_fraction": 0.9, **values}
    return DiagnosisRecord(4, 2, "Unbalance.", ("unbalance", "input_delay"), told)


def test_a_diagnosis_is_one_status_for_stock_tools():
    """The sentence is the message; the scalars are values by dotted name, as in JSON."""
    record = named(**{"remainder.structured": False, "remainder.share_of_gap": None})
    (status,) = codec.encode(record, machine="rotor").status
    assert (status.message, status.name, status.level) == ("Unbalance.", "diagnoser", 1)
    assert {pair.key: pair.value for pair in status.values} == {
        "experiment": "4",
        "model_version": "2",
        "effects": "unbalance,input_delay",
        "verdict.kind": "effect",
        "gap.closed_fraction": "0.9",
        "remainder.structured": "false",
        "remainder.share_of_gap": "null",
    }


@pytest.mark.parametrize(
    ("key", "text", "words"),
    [
        ("verdict.kind", "perhaps", "one of none, effect"),
        ("experiment", "0", "whole number from 1"),
    ],
)
def test_a_broken_diagnosis_is_refused_in_a_sentence(key, text, words):
    """Which field, what it should be."""
    message = codec.encode(named())
    next(pair for pair in message.status[0].values if pair.key == key).value = text
    with pytest.raises(RecordingError, match=words):
        codec.decode("diagnosis", message)
    message.status[0].values = [p for p in message.status[0].values if p.key != key]
    with pytest.raises(RecordingError, match=f"the key {key!r}"):
        codec.decode("diagnosis", message)


@pytest.mark.parametrize("text", ["NaN", "Infinity", "[1", "[1, 2]", "very large", "[" * 10**5])
def test_a_value_of_a_diagnosis_that_is_no_scalar_stays_a_word(text):
    """Others may add what they like."""
    message = codec.encode(named(theirs=1.0))
    next(pair for pair in message.status[0].values if pair.key == "theirs").value = text
    assert codec.decode("diagnosis", message).values["theirs"] == text


def test_texts_that_others_add_to_a_signal_are_left_alone():
    """The contract says `at least`: a further value need not be a number."""
    message = codec.encode(Signal(5, Level.POSITIVE, "lddm", 2, 0.1))
    message.status[0].values.append(standard().KeyValue(key="note", value="by hand"))
    assert codec.decode("signal", message).statistics == {}


def test_a_statistic_may_not_take_the_name_of_a_field():
    """It would overwrite the experiment's number on the wire."""
    with pytest.raises(ExperimentError, match="max_error"):
        codec.encode(Signal(5, Level.POSITIVE, "lddm", 2, 0.1, {"max_error": 1.0}))


GOOD = {"version": 1, "kind": "hybrid", "trained_on": [1], "parameters": {}}
BROKEN_MODELS = {
    "no JSON": "{",
    "a pickle": "\x80\x04K\x01.",
    "a list": "[]",
    "deep": "[" * 100_000,
    "endless number": '{"version": ' + "9" * 5000 + "}",
    "nan": json.dumps({**GOOD, "parameters": {"a": math.nan}}),
    "infinity": json.dumps({**GOOD, "parameters": {"a": -math.inf}}),
    "1e999": json.dumps(GOOD).replace("{}", '{"a": 1e999}'),
    "version a bool": json.dumps({**GOOD, "version": True}),
    "version below 0": json.dumps({**GOOD, "version": -1}),
    "trained on nothing known": json.dumps({**GOOD, "trained_on": ["one"]}),
    "parameters a list": json.dumps({**GOOD, "parameters": []}),
    "kind missing": json.dumps({k: v for k, v in GOOD.items() if k != "kind"}),
}


@pytest.mark.parametrize("fault", BROKEN_MODELS)
def test_a_text_that_is_no_model_is_refused_in_a_sentence(fault):
    """JSON of the declared shape with finite numbers, or a ModelError."""
    with pytest.raises(ModelError) as caught:
        codec.decode("model", standard().String(data=BROKEN_MODELS[fault]))
    assert len(str(caught.value)) < 300


def test_a_model_that_is_not_finite_is_never_sent():
    """NaN is no JSON, so that no reader has to guess."""
    with pytest.raises(ValueError, match="JSON"):
        codec.encode(ModelRecord(1, "linear", (), {"a": math.nan}))


@settings(max_examples=300)
@given(st.data())
def test_damaged_bytes_give_a_sentence_or_a_record_never_another_error(data):
    """Any byte of any message changed, or the end cut off."""
    topic = data.draw(
        st.sampled_from(["experiment", "prediction", "signal", "adaptation", "diagnosis", "model"])
    )
    record = {
        "experiment": example(),
        "prediction": Prediction(1, 0.0, 0.1, 0, [1, 2]),
        "signal": Signal(5, Level.POSITIVE, "lddm", 2, 0.1, {"rate": 0.5}),
        "adaptation": Adaptation(5, Action.REFUSED, 2, "worse", {"rmse": 0.5}),
        "diagnosis": named(),
        "model": ModelRecord(1, "linear", (1, 2), {"a": [1.5]}),
    }[topic]
    raw = bytearray(serialize(codec.encode(record)))
    raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    raw = raw[: data.draw(st.integers(0, len(raw)))]
    with contextlib.suppress(BadInput):
        codec.decode(topic, deserialize(bytes(raw), codec.DECODERS[topic][0], topic))
