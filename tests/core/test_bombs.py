"""Small files that unpack to much: refused in one short sentence, in little memory."""

from __future__ import annotations

import contextlib
import gzip
import tracemalloc
from collections.abc import Callable

import lz4.frame
import numpy as np
import pytest
import yaml
import zstandard
from mcap.writer import CompressionType, Writer

import msgs_config
from ldt_core.base.errors import BadInput, LdtError, MachineFileError, RecordingError, described
from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.base.plain_yaml import load_yaml
from ldt_core.cli import invoke, ldt
from ldt_core.cli.recordings import read_recordings
from ldt_core.machine.machine_file import load_machine, machine_from_dict
from ldt_core.python_api.recorded_experiments import read
from ldt_core.recording.bag import read_bag
from ldt_core.recording.codec import MULTI_ARRAY
from ldt_core.recording.csv_table import CsvTable
from ldt_core.recording.health import inspect
from ldt_core.recording.mcap_reader import TolerantMcapReader
from ldt_core.recording.mcap_records import decompress
from ldt_core.recording.writer import BagWriter
from ldt_core.runs.each_recording import Options, RecordingTask, diagnose_one

SENTENCE = 1500  # characters of the longest sentence about a file
MEGABYTE = 2**20


def peak(work: Callable[[], object]) -> float:
    """Most memory that work holds at a time [MB]."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1] / MEGABYTE
    finally:
        tracemalloc.stop()


def laughs(levels: int = 9) -> str:
    """A list of ten lists of ten lists."""
    lines = ["a0: &a0 [lol, lol, lol, lol, lol, lol, lol, lol, lol, lol]"]
    for n in range(1, levels):
        lines.append(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]")
    return "\n".join(lines)


@pytest.mark.parametrize("key", ["name", "physics", "parameters", "effects", "limits"])
def test_a_machine_file_of_aliases_is_refused(key, tmp_path):
    """Wherever the billion is asked for."""
    file = tmp_path / "machine.yaml"
    text = msgs_config.machine_text("dc_motor").replace(f"{key}:", f"was_{key}:")
    file.write_text(f"{laughs()}\n{text}\n{key}: *a8\n")

    def read() -> None:
        with pytest.raises(
            MachineFileError, match=r"line 2: the alias \*a0, which is not read"
        ) as e:
            load_machine(file)
        assert len(str(e.value)) < SENTENCE

    assert peak(read) < 10


def test_a_sentence_is_short_whatever_came():
    """Of a nested value no more is made a text than is shown."""
    nested: list[object] = ["lol"] * 10
    for _ in range(6):
        nested = [nested] * 10
    assert peak(lambda: described(nested)) < 10
    long = {**yaml.safe_load(msgs_config.machine_text("dc_motor")), "name": 10**5 * ["x"]}
    with pytest.raises(MachineFileError) as error:
        machine_from_dict(long, "file")
    assert len(str(error.value)) < SENTENCE
    assert load_yaml("a: '*b'") == {"a": "*b"}


def bomb(file, size: int, topic: str = "/x", kind: str = "x") -> None:
    """An MCAP file with one chunk of tiny messages."""
    with file.open("wb") as stream:
        writer = Writer(stream, chunk_size=2**31, compression=CompressionType.ZSTD)
        writer.start("ros2")
        schema = writer.register_schema(kind, "ros2msg", b"")
        channel = writer.register_channel(topic, "cdr", schema)
        for _ in range(size // 31):
            writer.add_message(channel, 0, b"", 0)
        writer.finish()


@pytest.mark.slow
def test_the_messages_of_a_chunk_are_made_one_after_the_other(tmp_path):
    """A hundred thousand in a chunk of 3 MB take no more than the chunk."""
    bomb(tmp_path / "a.mcap", 3 * MEGABYTE)
    reader = TolerantMcapReader(tmp_path / "a.mcap", pytest.fail)
    found = []
    assert peak(lambda: found.append(sum(1 for _ in reader.messages()))) < 15
    assert found[0] > 90_000


def test_a_chunk_that_claims_too_much_is_left_out(tmp_path, monkeypatch):
    """Beyond a hundred megabytes it may unpack to a hundred times what is packed."""
    monkeypatch.setattr("ldt_core.recording.mcap_records.FREE_CHUNK", MEGABYTE)
    bomb(tmp_path / "a.mcap", 3 * MEGABYTE)
    notes: list[str] = []
    assert list(TolerantMcapReader(tmp_path / "a.mcap", notes.append).messages()) == []
    assert any("claims to unpack" in note for note in notes)


def test_messages_that_are_none_are_read_to_a_limit_alone(tmp_path, monkeypatch):
    """A file of 5 kB can have two million of them; each is told of up to there."""
    bomb(tmp_path / "a.mcap", 100 * 31, "/rotor/experiment", MULTI_ARRAY)
    told: list[BadInput] = []

    def play() -> None:
        list(read_bag(tmp_path / "a.mcap").experiments(refused=told.append))

    with pytest.raises(RecordingError, match="0 bytes: too short"):
        play()
    assert len(told) == 100
    told.clear()
    monkeypatch.setattr("ldt_core.recording.bag.MOST_UNUSABLE", 9)
    with pytest.raises(RecordingError, match="at most 9 messages that are no such record, got mor"):
        play()
    assert len(told) == 10
    with pytest.raises(RecordingError, match="at most 9 messages that are no such record, got mor"):
        inspect(read_bag(tmp_path / "a.mcap"))  # as info and doctor do


def test_files_together_unpack_to_a_limit(tmp_path, monkeypatch):
    """A recording of 164 kB took 4 GB: each of its experiments kept its own limit."""
    monkeypatch.setattr("ldt_core.recording.held_samples.FREE_BYTES", MEGABYTE)
    folders = [str(tmp_path / name) for name in "ab"]
    for at, folder in enumerate(folders):
        with BagWriter(folder, "rotor") as writer:
            rows = np.full((2, 50_000), 6.0)
            writer.write("experiment", Experiment(1, 1e9 * (1 + at), 0.01, *rows), 1e9)
    assert len(read_recordings(folders[:1], "")) == 1
    with pytest.raises(RecordingError, match=r"samples of at most 1048576 bytes in files of"):
        read_recordings(folders, "")


def test_whoever_keeps_all_experiments_of_a_recording_has_that_limit(tmp_path, monkeypatch, capsys):
    """`ldt.read`, `tune`, `diagnose --each`; `advise` keeps the last ones alone."""
    monkeypatch.setattr("ldt_core.recording.held_samples.FREE_BYTES", MEGABYTE)
    bag = str(tmp_path / "a")
    with BagWriter(bag, "rotor") as writer:
        for number in (1, 2):
            rows = np.full((2, 50_000), 6.0)
            writer.write("experiment", Experiment(number, 1e9 * number, 0.01, *rows), 1e9)
    with pytest.raises(RecordingError, match=r"samples of at most 1048576 bytes in files of"):
        read(bag)
    each = diagnose_one(RecordingTask("a", bag, load_machine("rotor"), Options()))
    assert "samples of at most 1048576 bytes" in each.error
    assert invoke(ldt, ["tune", bag, "--adaptations", "1", "--out", str(tmp_path / "t")]) == 2
    assert "samples of at most 1048576 bytes" in capsys.readouterr().err
    assert invoke(ldt, ["advise", bag]) == 0


def test_whoever_keeps_all_predictions_has_that_limit(tmp_path, monkeypatch, capsys):
    """Those of numbers that no experiment has as well; `export` to MCAP keeps them, too."""
    bag = str(tmp_path / "a")
    with BagWriter(bag, "rotor") as writer:
        writer.write("experiment", Experiment(1, 1e9, 0.01, *np.full((2, 5), 6.0)), 1e9)
        for number in range(1, 5):
            for topic in ("prediction", "original_prediction"):
                writer.write(topic, Prediction(number, 1e9, 0.01, 0, np.full(20_000, 6.0)), 1e9)
    assert read(bag).steps == []
    monkeypatch.setattr("ldt_core.recording.held_samples.FREE_BYTES", MEGABYTE)
    recording = read(bag)
    with pytest.raises(RecordingError, match=r"samples of at most 1048576 bytes in files of"):
        recording.steps  # noqa: B018
    assert invoke(ldt, ["export", bag, "--out", str(tmp_path / "b.mcap")]) == 2
    assert "samples of at most 1048576 bytes" in capsys.readouterr().err


def test_messages_of_a_foreign_bag_are_counted_by_its_index(tmp_path, capsys, monkeypatch):
    """Two million were read one after the other to be counted."""
    bomb(tmp_path / "a.mcap", 100 * 31)
    monkeypatch.setattr(TolerantMcapReader, "messages", pytest.fail)
    assert invoke(ldt, ["info", str(tmp_path / "a.mcap")]) == 0
    assert "/x  x, 100 messages" in capsys.readouterr().out


@pytest.mark.parametrize("method", ["zstd", "lz4"])
def test_what_unpacks_to_more_than_stated_takes_no_more_than_that(method):
    """A chunk of 9 kB that states 1000 bytes took 300 MB."""
    packed = {"zstd": zstandard.compress, "lz4": lz4.frame.compress}[method](bytes(50 * MEGABYTE))

    def unpack() -> None:
        with contextlib.suppress(ValueError):
            assert len(decompress(method, packed, 1000)) == 1001

    assert peak(unpack) < 1


def test_a_packed_table_of_nothing_is_refused(tmp_path, monkeypatch):
    """The same rule; and reading one that is allowed takes a small multiple of it."""
    text = b"t,u,n\n" + b"0.00,1.00,2.00\n" * 200_000
    file = tmp_path / "a.csv.gz"
    file.write_bytes(gzip.compress(text))
    assert peak(lambda: CsvTable(file)) < 4 * len(text) / MEGABYTE
    monkeypatch.setattr("ldt_core.recording.csv_table.FREE_BYTES", MEGABYTE)
    monkeypatch.setattr("ldt_core.recording.csv_table.MOST_RATIO", 10)

    def refuse() -> None:
        with pytest.raises(RecordingError, match="expected at most 1048576 bytes"):
            CsvTable(file)

    assert peak(refuse) < 6


def test_every_error_of_bad_input_is_bounded():
    """Whatever a caller puts into it."""
    error: LdtError = RecordingError("file", "a thing", "x" * 10**6)
    assert len(str(error)) < SENTENCE
