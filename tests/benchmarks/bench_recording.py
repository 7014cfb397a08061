"""Recording a run, from messages and from records, against the bare `mcap` writer given bytes."""

from __future__ import annotations

import itertools
import shutil
import tempfile
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, IndexType, Writer

from ldt_core.base.experiment import Action, Adaptation, Experiment, Level, Prediction, Signal
from ldt_core.recording.bag import read_bag
from ldt_core.recording.codec import DECODERS, encode
from ldt_core.recording.messages import schema, serialize
from ldt_core.recording.writer import BagWriter
from tests.benchmarks.row import Row, best_of

EXPERIMENTS, SAMPLES, NOISE = 200, 2000, 0.1  # a run of the rotor: 20 s at 100 Hz each
REPEATS = 7


def records() -> list[tuple[str, float, object]]:
    """(topic, time, record) of a run."""
    noise = np.random.default_rng(0)
    listed: list[tuple[str, float, object]] = []
    for number in range(1, EXPERIMENTS + 1):
        voltage = np.repeat(noise.uniform(6, 16, SAMPLES // 100), 100)
        speed = voltage * 3 + noise.normal(scale=NOISE, size=SAMPLES)
        one = Experiment(number, 20.0 * number, 0.01, voltage, speed)
        guess = Prediction(number, one.start, one.period, 0, voltage * 3, np.full(SAMPLES, NOISE))
        signal = Signal(number, Level.NEGATIVE, "threshold", 0, 0.5, {"threshold": 3.0})
        done = Adaptation(number, Action.KEPT, 0, "the prediction holds", {"memory": 0.0})
        for topic, record in (
            ("experiment", one),
            ("prediction", guess),
            ("original_prediction", guess),
            ("signal", signal),
            ("adaptation", done),
        ):
            listed.append((topic, one.end, record))
    return listed


def ours(path: Path, listed: list[tuple[str, float, object]]) -> None:
    """Records → recording."""
    with BagWriter(path, "rotor") as bag:
        for topic, time, record in listed:
            bag.write(topic, record, time)


def recorder(path: Path, ready: list[tuple[str, int, bytes]]) -> None:
    """Bytes → recording, as the recorder node gets them."""
    with BagWriter(path, "rotor") as bag:
        for topic, time, data in ready:
            bag.write_raw(f"/{topic}", DECODERS[topic][0], data, time)


def bare(path: Path, ready: list[tuple[str, int, bytes]], schemas: dict[str, bytes]) -> None:
    """Bytes → MCAP file with the same chunk size, compression and indexes, and nothing else."""
    with path.open("wb") as stream:
        writer = Writer(
            stream,
            compression=CompressionType.ZSTD,
            index_types=IndexType.CHUNK | IndexType.MESSAGE | IndexType.METADATA,
        )
        writer.start("ros2")
        channels: dict[str, int] = {}
        for topic, time, data in ready:
            if topic not in channels:
                kind = DECODERS[topic][0]
                number = writer.register_schema(kind, "ros2msg", schemas[kind])
                channels[topic] = writer.register_channel(f"/{topic}", "cdr", number)
            writer.add_message(channels[topic], time, data, time)
        writer.finish()


def run() -> list[Row]:
    """Writing against `mcap`, reading against `rosbags`."""
    from rosbags.highlevel import AnyReader

    listed = records()
    ready = [(t, round(at * 1e9), serialize(encode(r, machine="rotor"))) for t, at, r in listed]
    schemas = {kind: schema(kind)[0].encode() for kind, _ in DECODERS.values()}
    megabytes = sum(len(data) for _, _, data in ready) / 1e6
    folder = Path(tempfile.mkdtemp(prefix="ldt_bench_"))

    def theirs() -> int:
        with AnyReader([folder / "run_0"]) as reader:
            wanted = [c for c in reader.connections if c.topic == "/experiment"]
            messages = reader.messages(wanted)
            return sum(1 for c, _, data in messages if reader.deserialize(data, c.msgtype))

    try:
        fresh = (folder / f"run_{number}" for number in itertools.count())
        writing = best_of(REPEATS, lambda: ours(next(fresh), listed))
        raw = best_of(REPEATS, lambda: recorder(next(fresh), ready))
        peer = best_of(REPEATS, lambda: bare(next(fresh), ready, schemas))
        reading = best_of(REPEATS, lambda: list(read_bag(folder / "run_0").experiments()))
        others = best_of(REPEATS, theirs)
    finally:
        shutil.rmtree(folder)
    size = f"{len(listed)} messages, {megabytes:.0f} MB, zstd"
    return [
        Row("record messages as they arrive", raw, "bare mcap writer", peer, "above 1/1.3", size),
        Row(
            "record a run, encoding included",
            writing,
            "bare mcap writer, given encoded messages",
            peer,
            "above 1/1.3",
            f"{size}; LDT also encodes the messages",
        ),
        Row(
            "read the experiments of a run",
            reading,
            "rosbags, without checks",
            others,
            "-",
            f"{EXPERIMENTS} experiments of {SAMPLES} samples, each checked when read",
        ),
    ]
