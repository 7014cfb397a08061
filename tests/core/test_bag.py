"""Claims about recordings: what is written is read back, also by others, also after a crash."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import textwrap
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, IndexType, Writer

from ldt_core.base.errors import ExperimentError, LdtError, RecordingError
from ldt_core.base.experiment import (
    Action,
    Adaptation,
    Experiment,
    Level,
    ModelRecord,
    Prediction,
    Signal,
)
from ldt_core.recording.bag import experiments, read_bag
from ldt_core.recording.codec import encode
from ldt_core.recording.messages import MULTI_ARRAY, STRING, schema, serialize, standard, typestore
from ldt_core.recording.writer import BagWriter

START = 1.7e9


def experiment(number: int, length: int = 50) -> Experiment:
    random_ = np.random.default_rng(number)
    return Experiment(
        number, START + number, 0.01, random_.normal(size=length), random_.normal(size=length)
    )


def write(path: Path, numbers, namespace: str = "", length: int = 50) -> Path:
    with BagWriter(path, "rotor", namespace) as bag:
        for number in numbers:
            one = experiment(number, length)
            bag.write("experiment", one, one.end)
    return path


def equal(a: Experiment, b: Experiment) -> bool:
    return (
        (a.number, a.start, a.period) == (b.number, b.start, b.period)
        and a.voltage.tobytes() == b.voltage.tobytes()
        and a.speed.tobytes() == b.speed.tobytes()
    )


def numbers(path: Path, namespace: str | None = None) -> list[int]:
    return [e.number for e in experiments(path, namespace).experiments]


def test_a_whole_run_is_read_back_bit_equal_from_folder_and_bare_file(tmp_path):
    """Every kind of record, in the order in which it was written."""
    one = experiment(1)
    records = {
        "experiment": one,
        "prediction": Prediction(1, one.start, one.period, 3, one.speed, np.abs(one.speed)),
        "signal": Signal(1, Level.POSITIVE, "threshold", 3, 1 / 3, {"limit": 0.1}),
        "model": ModelRecord(4, "hybrid", (1,), {"weights": [1 / 3, 2.0]}),
        "adaptation": Adaptation(1, Action.ADAPTED, 4, "better on held-out data", {"rmse": 1 / 7}),
    }
    with BagWriter(tmp_path / "run", "rotor") as bag:
        for topic, record in records.items():
            bag.write(topic, record, one.end)
        assert bag.counts == {f"/{topic}": 1 for topic in records}
    for path in (tmp_path / "run", tmp_path / "run" / "run_0.mcap"):
        back = read_bag(path)
        assert list(back.topics) == [f"/{topic}" for topic in records]
        assert equal(next(back.records("experiment")), one)
        prediction = next(back.records("prediction"))
        assert prediction.speed_std.tobytes() == np.abs(one.speed).tobytes()
        for topic in ("signal", "model", "adaptation"):
            assert list(back.records(topic)) == [records[topic]]
        assert back.notes == []


def test_other_readers_read_every_message_equal(tmp_path):
    """`rosbags` and `mcap-ros2-support` agree with what was written."""
    highlevel = pytest.importorskip("rosbags.highlevel")
    mcap_ros2 = pytest.importorskip("mcap_ros2.reader")
    path = write(tmp_path / "run", range(1, 6))
    with highlevel.AnyReader([path]) as reader:
        theirs = [reader.deserialize(d, c.msgtype) for c, _, d in reader.messages()]
    again = [m.ros_msg for m in mcap_ros2.read_ros2_messages(str(path / "run_0.mcap"))]
    assert len(theirs) == len(again) == 5
    for number, (first, second) in enumerate(zip(theirs, again, strict=True), start=1):
        ours = encode(experiment(number))
        assert np.array_equal(first.data, ours.data)
        assert np.array_equal(second.data, ours.data)
        assert first.layout.dim[1].label == second.layout.dim[1].label == "voltage,speed"
        assert first.layout.data_offset == second.layout.data_offset == 3


def test_a_killed_writer_loses_at_most_the_last_half_second(tmp_path, programs):
    """kill -9 in the middle of writing: a streaming read gives all but the last 0.5 s."""
    program = textwrap.dedent(
        """
        import sys, time
        from ldt_core.recording.writer import BagWriter
        from ldt_core.base.experiment import Experiment
        bag = BagWriter(sys.argv[1], "rotor", topics=("experiment",))
        for number in range(1, 100_000):
            now = time.time()
            bag.write("experiment", Experiment(number, now, 0.01, [1.0], [2.0]), now)
            print(number, time.time(), flush=True)
            time.sleep(0.01)
        """
    )
    path = tmp_path / "run"
    process = programs.start(
        [sys.executable, "-c", program, str(path)], stdout=subprocess.PIPE, text=True
    )
    lines = []
    until = time.monotonic() + 60
    while len(lines) < 150 and time.monotonic() < until:
        lines.append(process.stdout.readline().split())
    killed = time.time()
    process.send_signal(signal.SIGKILL)
    rest = process.communicate()[0]
    lines += [line.split() for line in rest.splitlines()]
    safe = [int(n) for n, written in lines if float(written) < killed - 0.5]
    assert safe
    bag = read_bag(path)
    found = [e.number for e in bag.experiments()]
    assert found == list(range(1, len(found) + 1))
    assert len(found) >= len(safe)
    assert "has no end" in bag.notes[0]


def test_the_last_message_reaches_the_file_without_a_further_one(tmp_path):
    """A slow machine writes once in 20 s: its experiment does not wait that long in memory."""
    with BagWriter(tmp_path / "run", "rotor") as bag:
        bag.write("experiment", experiment(1), START)
        until = time.monotonic() + 5
        while time.monotonic() < until:
            time.sleep(0.05)
            with contextlib.suppress(RecordingError):
                if numbers(tmp_path / "run") == [1]:
                    break
        else:
            pytest.fail("nothing was flushed within 5 s")


def test_a_folder_is_a_bag_from_the_beginning(tmp_path):
    """`metadata.yaml` is there before the first message, and names the declared topics."""
    bag = BagWriter(tmp_path / "run", "rotor", topics=("experiment", "signal"))
    text = (tmp_path / "run" / "metadata.yaml").read_text()
    bag.close()
    assert "/experiment" in text
    assert "run_0.mcap" in text


def test_a_recording_is_never_overwritten(tmp_path):
    """An existing folder is refused, whatever is in it; the recording there is not touched."""
    path = write(tmp_path / "run", [1])
    with pytest.raises(RecordingError, match="does not exist yet"):
        BagWriter(path)
    assert numbers(path) == [1]


@pytest.mark.parametrize("place", ["/proc/ldt_bag", "{file}/bag"])
def test_a_place_that_cannot_be_written_is_refused_in_a_sentence(tmp_path, place):
    """A read-only file system and a file in the way."""
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError) as caught:
        BagWriter(place.format(file=tmp_path / "file"))
    assert caught.value.exit_code == 2


def test_a_file_that_may_not_grow_stops_the_recording_and_keeps_what_is_there(tmp_path):
    """A full disk, by way of the process's limit on file sizes: every later call says the same."""
    program = textwrap.dedent(
        """
        import resource, sys
        from ldt_core.base.errors import LdtError
        from ldt_core.recording.writer import BagWriter
        from ldt_core.base.experiment import Experiment
        import numpy as np
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
        bag = BagWriter(sys.argv[1], "rotor")
        noise = np.random.default_rng(0)
        said = []
        for number in range(1, 60):
            try:
                row = noise.normal(size=1000)
                bag.write("experiment", Experiment(number, 0.0, 0.01, row, row), float(number))
                bag.flush()
            except LdtError as error:
                assert error.exit_code == 1
                said.append(str(error))
        try:
            bag.close()
        except LdtError as error:
            said.append(str(error))
        assert len(said) > 5 and len(set(said)) == 1
        print(said[0])
        """
    )
    path = tmp_path / "run"
    done = subprocess.run(
        [sys.executable, "-c", program, str(path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "recording stopped after" in done.stdout
    assert done.stderr == ""
    kept = experiments(path)
    assert len(kept.experiments) >= 5
    assert kept.notes


def test_a_write_after_the_end_is_an_error_and_a_second_close_is_none(tmp_path):
    """A closed recording has its index already."""
    bag = BagWriter(tmp_path / "run")
    bag.close()
    bag.close()
    with pytest.raises(LdtError, match="closed"):
        bag.write("experiment", experiment(1), START)


def test_an_undeclared_topic_and_an_impossible_time_are_refused(tmp_path):
    """The recorder writes what `topics.yaml` declares, at times that rosbag2 can hold."""
    with BagWriter(tmp_path / "run") as bag:
        with pytest.raises(RecordingError, match="did you mean 'experiment'"):
            bag.write("experimnt", experiment(1), START)
        for wrong in (-1.0, 1e11, float("nan"), float("inf")):
            with pytest.raises(RecordingError, match="seconds since the epoch"):
                bag.write("experiment", experiment(1), wrong)
    with pytest.raises(RecordingError, match="did you mean"):
        BagWriter(tmp_path / "other", topics=("experimnt",))
    assert not (tmp_path / "other").exists()


def test_namespaced_topics_are_found_by_their_last_part(tmp_path):
    """One machine needs no --namespace."""
    path = write(tmp_path / "run", [1, 2], namespace="hall/machine_1")
    assert read_bag(path).namespace == "/hall/machine_1"
    assert numbers(path) == [1, 2]


def test_several_machines_need_a_namespace_and_the_error_lists_them(tmp_path):
    """With one, its experiments alone are read, and /diagnostics belongs to all."""
    with BagWriter(tmp_path / "run") as bag:
        for k, number in (("machine_1", 1), ("machine_2", 2), ("machine_1", 3)):
            bag.write(f"/{k}/experiment", experiment(number), START + number)
        health = standard().DiagnosticArray(
            header=standard().Header(stamp=standard().Time(sec=0, nanosec=0), frame_id=""),
            status=[],
        )
        bag.write("/diagnostics", health, START)
    with pytest.raises(RecordingError, match=r"/machine_1 and /machine_2"):
        read_bag(tmp_path / "run")
    with pytest.raises(RecordingError, match=r"only /machine_1 and /machine_2"):
        read_bag(tmp_path / "run", "machine_3")
    assert numbers(tmp_path / "run", "machine_1") == [1, 3]
    assert numbers(tmp_path / "run", "/machine_2/") == [2]
    assert "/diagnostics" in read_bag(tmp_path / "run", "machine_2").topics


def test_of_a_topic_that_a_recording_lacks_nothing_comes(tmp_path):
    """Neither records nor messages, by either of its names; experiments alone are asked for."""
    with BagWriter(tmp_path / "run", "rotor") as writer:
        writer.write("prediction", Prediction(1, 1e9, 0.01, 0, np.zeros(3)), 1e9)
    bag = read_bag(tmp_path / "run")
    for name in ("diagnosis", "/diagnosis", "no_such"):
        assert list(bag.records(name)) == list(bag.rare(name)) == list(bag.messages(name)) == []
    assert len(list(bag.messages("diagnosis", "prediction"))) == 1
    with pytest.raises(RecordingError, match="expected the topic /experiment, got only /predict"):
        list(bag.experiments())


def test_repeated_and_missing_numbers_are_noted(tmp_path):
    """They are read all the same."""
    notes = experiments(write(tmp_path / "run", [2, 3, 3, 7, 9])).notes
    assert any("more than once: experiment 3" in n for n in notes)
    assert any("missing: experiments 4 to 6, 8" in n for n in notes)


def test_a_bad_experiment_in_a_recording_is_left_out_and_named(tmp_path):
    """By file, topic and message: the second of two has a NaN. Alone, it is refused."""
    bad = encode(experiment(2))
    bad.data[7] = np.nan
    with BagWriter(tmp_path / "run") as bag:
        bag.write("experiment", experiment(1), START)
        bag.write("experiment", bad, START)
    whole = read_bag(tmp_path / "run")
    assert [e.number for e in whole.experiments()] == [1]
    (told,) = whole.notes
    assert "run: 1 message of /experiment left out" in told
    assert "run, /experiment, message 2, experiment 2, voltage" in told
    with BagWriter(tmp_path / "alone") as bag:
        bag.write("experiment", bad, START)
    with pytest.raises(ExperimentError, match=r"alone, /experiment, message 1, experiment 2, volt"):
        numbers(tmp_path / "alone")


def test_what_a_twin_could_not_use_is_left_out_of_its_recording_and_noted(tmp_path):
    """A stranger's message among hundreds must not make a run unreadable; nor hide that it came."""
    bad = encode(experiment(9))
    bad.layout.dim = []
    with BagWriter(tmp_path / "run") as bag:
        for number in (1, 2, 3):
            one = experiment(number)
            bag.write("experiment", one, one.end)
            bag.write("experiment", bad, one.end)
            bag.write("prediction", Prediction(number, one.start, 0.01, 0, one.speed), one.end)
    found = experiments(tmp_path / "run")
    assert [e.number for e in found.experiments] == [1, 2, 3]
    assert found.notes == [
        f"{tmp_path}/run: 3 messages of /experiment left out, as a twin does, the first because "
        f"{tmp_path / 'run'}, /experiment, message 2, layout.dim: expected two dimensions, got 0"
    ]


def test_a_topic_of_nothing_but_unusable_messages_is_refused(tmp_path):
    """Then it is not the twin's topic, or of another layout: to leave all of it out hides that."""
    bad = encode(experiment(2))
    bad.layout.dim = []
    with BagWriter(tmp_path / "run") as bag:
        bag.write("experiment", bad, START)
        bag.write("prediction", Prediction(1, START, 0.01, 0, np.zeros(3)), START)
    with pytest.raises(ExperimentError, match=r"message 1, layout\.dim: expected two"):
        experiments(tmp_path / "run")


def _empty_folder(path):
    path.mkdir()


def _foreign_folder(path):
    path.mkdir()
    (path / "metadata.yaml").write_text("a: [1, 2")
    (path / "data.csv").write_text("a,b")


def _missing_file(path):
    write(path, [1])
    (path / f"{path.name}_0.mcap").unlink()


def _no_experiments(path):
    BagWriter(path, topics=("experiment",)).close()


def _foreign_topics(path):
    with BagWriter(path) as bag:
        bag.write_raw("/chatter", STRING, serialize(standard().String(data="hello")), 5)


def _wrong_type(path):
    with BagWriter(path) as bag:
        bag.write_raw("/experiment", STRING, serialize(standard().String(data="hello")), 5)


UNUSABLE = {
    "missing": (lambda path: None, "no such file"),
    "empty folder": (_empty_folder, "rosbag2 folder"),
    "foreign folder": (_foreign_folder, "rosbag2 folder"),
    "file of the folder missing": (_missing_file, "_0.mcap"),
    "zero bytes": (lambda path: path.write_bytes(b""), "an empty file"),
    "magic alone": (lambda path: path.write_bytes(b"\x89MCAP0\r\n"), "no messages"),
    "text": (lambda path: path.write_text("time,speed\n1,2\n"), "got a text"),
    "ROS 1": (lambda path: path.write_bytes(b"#ROSBAG V2.0\n" + bytes(99)), "ROS 1"),
    "SQLite of others": (lambda path: path.write_bytes(b"SQLite format 3\0" + bytes(99)), "SQLite"),
    "no experiments": (_no_experiments, "none"),
    "foreign topics": (_foreign_topics, "/chatter"),
    "wrong type": (_wrong_type, STRING),
}


@pytest.mark.parametrize("fault", UNUSABLE)
def test_an_unusable_recording_is_refused_in_a_sentence(tmp_path, fault):
    """The sentence names the file and what is there instead."""
    make, named = UNUSABLE[fault]
    path = tmp_path / "run"
    make(path)
    with pytest.raises(RecordingError) as caught:
        experiments(path)
    assert str(path) in str(caught.value)
    assert named in str(caught.value)
    assert "\n" not in str(caught.value)


def test_reading_a_recording_takes_bounded_memory(tmp_path):
    """300 experiments of 2000 samples (10 MB of samples) pass through less than 8 MB."""
    path = write(tmp_path / "run", range(1, 301), length=2000)
    next(read_bag(path).experiments())
    tracemalloc.start()
    try:
        count = sum(1 for _ in read_bag(path).experiments())
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert count == 300
    assert peak < 8e6


def _rosbags(path, storage, compression=None):
    from rosbags.rosbag2 import Writer as Rosbag2Writer

    writer = Rosbag2Writer(path, version=9, storage_plugin=storage)
    if compression is not None:
        from rosbags.rosbag2 import CompressionFormat

        writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/m/experiment", MULTI_ARRAY, typestore=typestore())
        for number in (1, 2, 3):
            writer.write(connection, number, serialize(encode(experiment(number))))


@pytest.mark.parametrize(
    ("storage", "compression"),
    [("MCAP", "NONE"), ("MCAP", "FILE"), ("MCAP", "MESSAGE"), ("SQLITE3", "NONE")],
)
def test_recordings_of_the_rosbags_library_are_read(tmp_path, storage, compression):
    """MCAP uncompressed, each file or each message compressed with zstd; SQLite."""
    from rosbags.rosbag2 import CompressionMode, StoragePlugin

    path = tmp_path / "run"
    _rosbags(path, StoragePlugin[storage], CompressionMode[compression])
    found = experiments(path)
    assert [e.number for e in found.experiments] == [1, 2, 3]
    assert all(equal(e, experiment(e.number)) for e in found.experiments)
    assert found.notes == []


def test_a_compressed_sqlite_file_is_refused_with_the_way_out(tmp_path):
    """SQLite cannot be read as a stream."""
    from rosbags.rosbag2 import CompressionMode, StoragePlugin

    _rosbags(tmp_path / "run", StoragePlugin.SQLITE3, CompressionMode.FILE)
    with pytest.raises(RecordingError, match="zstd -d"):
        numbers(tmp_path / "run")


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("indexed", [True, False])
def test_bare_mcap_files_of_any_make_are_read(tmp_path, compression, chunked, indexed):
    """Chunks or none, an index or none, every compression of the format."""
    file = tmp_path / "x.mcap"
    with file.open("wb") as stream:
        writer = Writer(
            stream,
            compression=compression,
            use_chunking=chunked,
            index_types=IndexType.ALL if indexed else IndexType.NONE,
            repeat_channels=indexed,
            repeat_schemas=indexed,
        )
        writer.start("ros2")
        kind = writer.register_schema(MULTI_ARRAY, "ros2msg", schema(MULTI_ARRAY)[0].encode())
        channel = writer.register_channel("/experiment", "cdr", kind)
        for number in (1, 2):
            writer.add_message(channel, number, serialize(encode(experiment(number))), number)
        writer.finish()
    assert numbers(file) == [1, 2]


def test_a_recording_of_several_files_is_read_in_their_order(tmp_path):
    """Split by rosbag2: _0 … _10, listed or not; one of them missing is noted."""
    path = tmp_path / "run"
    path.mkdir()
    for part in range(11):
        write(tmp_path / "part", [part + 1])
        (tmp_path / "part" / "part_0.mcap").rename(path / f"run_{part}.mcap")
        for left in (tmp_path / "part").iterdir():
            left.unlink()
        (tmp_path / "part").rmdir()
    assert numbers(path) == list(range(1, 12))
    files = "".join(f"  - run_{part}.mcap\n" for part in range(11))
    (path / "metadata.yaml").write_text(
        f"rosbag2_bagfile_information:\n  version: 9\n  relative_file_paths:\n{files}"
    )
    assert numbers(path) == list(range(1, 12))
    (path / "run_4.mcap").unlink()
    found = experiments(path)
    assert len(found.experiments) == 10
    assert any("run_4.mcap, which is missing" in n for n in found.notes)


def test_a_file_list_that_points_elsewhere_stays_in_the_folder(tmp_path):
    """Paths in metadata.yaml come from outside: only their last part counts."""
    write(tmp_path / "secret", [5])
    path = write(tmp_path / "run", [1])
    text = (path / "metadata.yaml").read_text()
    text = text.replace("- run_0.mcap", "- ../secret/secret_0.mcap")
    (path / "metadata.yaml").write_text(text)
    assert numbers(path) == [1]


def test_a_decompression_bomb_is_left_out(tmp_path):
    """A chunk that claims 2 TB is damage, not a reason to allocate it."""
    path = write(tmp_path / "run", [1])
    file = path / "run_0.mcap"
    data = bytearray(file.read_bytes())
    at = data.index(b"\x06", 8 + 9)  # the chunk record behind the header
    while int.from_bytes(data[at + 1 : at + 9], "little") > len(data):
        at = data.index(b"\x06", at + 1)
    data[at + 9 + 16 : at + 9 + 24] = (2 * 10**12).to_bytes(8, "little")
    file.write_bytes(data)
    with pytest.raises(RecordingError, match="claims"):
        numbers(path)


def test_a_compressed_file_that_is_cut_gives_what_is_left(tmp_path):
    """rosbag2's file compression, truncated in the middle."""
    path = write(tmp_path / "run", range(1, 200), length=2000)
    packed = zstandard.compress((path / "run_0.mcap").read_bytes())
    file = tmp_path / "cut.mcap.zstd"
    file.write_bytes(packed[: len(packed) // 2])
    found = experiments(file)
    assert 1 < len(found.experiments) < 199
    assert found.notes


def test_an_unclosed_writer_does_not_keep_the_process_alive(tmp_path):
    """A forgotten close loses the index, not the process."""
    program = (
        "import sys\nfrom ldt_core.recording.writer import BagWriter\n"
        "bag = BagWriter(sys.argv[1], topics=('experiment',))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "run")], timeout=60, check=False
    )
    assert done.returncode == 0
    assert os.path.exists(tmp_path / "run" / "metadata.yaml")


def test_a_topic_of_two_types_is_refused_by_both(tmp_path):
    """Its last channel's type was taken for all: a recording of LDT's was called a foreign one."""
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        for kind in (MULTI_ARRAY, STRING):
            described = writer.register_schema(kind, "ros2msg", schema(kind)[0].encode())
            channel = writer.register_channel("/experiment", "cdr", described)
            writer.add_message(channel, 1, serialize(encode(experiment(1))), 1)
        writer.finish()
    with pytest.raises(RecordingError, match=f"one message type, {MULTI_ARRAY}, got {STRING}"):
        read_bag(tmp_path / "a.mcap")
