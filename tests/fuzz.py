"""Bytes, messages and machine files of every sort: refused in a sentence, never a crash.

python -m tests.fuzz [--count 10000] [--seed 1]

Each of the three is made COUNT times, half of them from a good one with something changed. What the
twin then does with what is let through is tried as well: it predicts, judges and learns.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import yaml
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

import msgs_config
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import (
    Action,
    Adaptation,
    Experiment,
    Level,
    ModelRecord,
    Prediction,
    Signal,
)
from ldt_core.machine.machine_file import load_machine, parse_machine
from ldt_core.recording.codec import DECODERS, decode, encode, encode_cdr
from ldt_core.recording.messages import deserialize, standard
from ldt_core.twin.loop import Twin

LENGTH = 30
MACHINE = replace(load_machine("rotor"), duration=LENGTH * 0.01)
REST = np.zeros(LENGTH)
GOOD = {
    "experiment": Experiment(1, 1e9, 0.01, REST + 5, REST),
    "prediction": Prediction(1, 1e9, 0.01, 0, REST, REST + 0.1),
    "signal": Signal(1, Level.WARNING, "threshold", 0, 1.5, {"threshold": 3.0}),
    "adaptation": Adaptation(1, Action.STORED, 0, "a warning", {"warning_set": 1.0}),
    "model": ModelRecord(0, "linear", (), {"a": [0.5], "b": [0.1], "c": 0.0}),
}
TEXT = st.text(max_size=40) | st.sampled_from(
    ["", "nan", "inf", "-1", "1e999", "9" * 400, "../../x", "<script>", "\x1b[2J", "null", "{"]
)
NUMBER = st.floats() | st.sampled_from([0.0, -0.0, 1.0, 2.0, 1e300, float("nan"), float("inf")])
WHOLE = st.integers(-(2**31), 2**32 - 1).map(lambda n: n % 2**32)
TREE = st.recursive(
    st.none() | st.booleans() | st.integers() | NUMBER | TEXT,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXT, inner, max_size=4),
    max_leaves=12,
)
KEYS = st.sampled_from(
    ["experiment", "detector", "model_version", "max_error", "reason", "name", "x", ""]
)


@st.composite
def arrays(draw: Callable[..., object]) -> object:
    """A Float64MultiArray whose parts need not agree."""
    make = standard()
    label = st.sampled_from(["sample", "voltage,speed", "speed", "speed,speed_std", ","]) | TEXT
    side = st.builds(make.MultiArrayDimension, label=label, size=WHOLE, stride=WHOLE)
    layout = make.MultiArrayLayout(dim=draw(st.lists(side, max_size=3)), data_offset=draw(WHOLE))
    data = np.array(draw(st.lists(NUMBER, max_size=80)), dtype=np.float64)
    return make.Float64MultiArray(layout=layout, data=data)


@st.composite
def statuses(draw: Callable[..., object]) -> object:
    """A DiagnosticArray of anything."""
    make = standard()
    pair = st.builds(make.KeyValue, key=KEYS | TEXT, value=TEXT)
    one = st.builds(
        make.DiagnosticStatus,
        level=st.integers(0, 255),
        name=TEXT,
        message=st.sampled_from(["positive", "negative", "kept", "adapted"]) | TEXT,
        hardware_id=TEXT,
        values=st.lists(pair, max_size=6),
    )
    time = make.Time(sec=draw(st.integers(-(2**31), 2**31 - 1)), nanosec=draw(WHOLE))
    header = make.Header(stamp=time, frame_id=draw(TEXT))
    return make.DiagnosticArray(header=header, status=draw(st.lists(one, max_size=3)))


@st.composite
def spoiled(draw: Callable[..., object], topic: str) -> bytes:
    """CDR bytes of a good message, with some changed, or cut."""
    data = bytearray(encode_cdr(GOOD[topic], "rotor", 1e9))
    for _ in range(draw(st.integers(1, 6))):
        data[draw(st.integers(0, len(data) - 1))] = draw(st.integers(0, 255))
    return bytes(data[: draw(st.integers(0, len(data)))] if draw(st.booleans()) else data)


@st.composite
def models(draw: Callable[..., object]) -> object:
    """A String that may be a model."""
    text = draw(TEXT)
    if draw(st.booleans()):
        text = yaml.safe_dump(draw(TREE), default_flow_style=True)
    return standard().String(data=text)


@st.composite
def machine_files(draw: Callable[..., object]) -> str:
    """A machine file with something changed, or any text."""
    if draw(st.booleans()):
        return draw(TEXT) + draw(TEXT)
    data = yaml.safe_load(msgs_config.machine_text("rotor"))
    where = data
    while draw(st.booleans()) and any(isinstance(v, dict) for v in where.values()):
        where = where[draw(st.sampled_from([k for k, v in where.items() if isinstance(v, dict)]))]
    key = draw(st.sampled_from(sorted(where)) | TEXT)
    where[key] = draw(TREE)
    return yaml.safe_dump(data)


def message(data: st.DataObject, told: Counter[str]) -> None:
    """A message of some topic, from its bytes or its parts, up to the record in it."""
    topic = data.draw(st.sampled_from(sorted(GOOD)))
    kind = DECODERS[topic][0]
    try:
        if data.draw(st.booleans()):
            made = deserialize(data.draw(spoiled(topic)), kind, topic)
        elif topic == "model":
            made = data.draw(models())
        else:
            made = data.draw(arrays() if topic in ("experiment", "prediction") else statuses())
        record = decode(topic, made)
    except LdtError as error:
        told[f"{topic}: refused"] += 1
        _one_sentence(error)
    else:
        told[f"{topic}: let through"] += 1
        encode(record)


#: Samples, start [s since the epoch] and period [s] of what the machine may have made.
USUAL = st.floats(-24.0, 24.0), st.floats(0.0, 9e9), st.floats(0.001, 1.0)


def turn(data: st.DataObject, told: Counter[str]) -> None:
    """What is let through as an experiment goes through predictor, detector and adaptor."""
    number = data.draw(st.integers(1, 3))
    # By anything alone, it is chance, and what else is loaded, whether one in 150 can be.
    each, start, length = data.draw(st.sampled_from([(NUMBER, NUMBER, NUMBER), USUAL]))
    rows = st.lists(each, min_size=1, max_size=12)
    twin = Twin(MACHINE, model=data.draw(st.sampled_from(["linear", "physics"])))
    try:
        voltage = data.draw(rows)
        speed = data.draw(st.lists(each, min_size=len(voltage), max_size=len(voltage)))
        period = data.draw(length)
        one = Experiment(number, data.draw(start), period, np.array(voltage), np.array(speed))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            twin.step(one)
    except LdtError as error:
        told["experiment in the loop: refused"] += 1
        _one_sentence(error)
    else:
        told["experiment in the loop: let through"] += 1


def machine(data: st.DataObject, told: Counter[str]) -> None:
    """A machine file."""
    try:
        parse_machine(data.draw(machine_files()), "own.yaml")
    except LdtError as error:
        told["machine file: refused"] += 1
        _one_sentence(error)
    else:
        told["machine file: let through"] += 1


def _one_sentence(error: LdtError) -> None:
    assert len(str(error)) < 2000, str(error)[:200]


KINDS = {"message": message, "turn": turn, "machine": machine}


def fuzz(kind: str, count: int, begin: int) -> Counter[str]:
    """How often each end came; raises whatever was no refusal."""
    told: Counter[str] = Counter()

    @seed(begin)
    @settings(max_examples=count, deadline=None, database=None, phases=[Phase.generate],
              suppress_health_check=list(HealthCheck))  # fmt: skip
    @given(st.data())
    def tried(data: st.DataObject) -> None:
        KINDS[kind](data, told)

    tried()
    return told


def main() -> int:
    """All kinds, and a table."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    for kind in KINDS:
        for what, times in sorted(fuzz(kind, chosen.count, chosen.seed).items()):
            print(f"{what}: {times}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
