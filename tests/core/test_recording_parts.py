"""Claims about long recordings: split by size, taken up again, with what is recorded known."""

from __future__ import annotations

import contextlib
import errno
import multiprocessing
import os
import random
import shutil
import signal
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.records import Channel

from ldt_core.base.errors import LdtError, RecordingError
from ldt_core.base.experiment import Action, Adaptation, Experiment, Level, ModelRecord, Signal
from ldt_core.base.sentences import spans
from ldt_core.recording import mcap_completion, mcap_reader, mcap_records
from ldt_core.recording.bag import experiments, read_bag
from ldt_core.recording.codec import DECODERS, encode_cdr
from ldt_core.recording.experiment_numbers import (
    ExperimentNumbers,
    numbers_text,
    parse_numbers,
)
from ldt_core.recording.health import inspect
from ldt_core.recording.lock import FolderLock, is_written
from ldt_core.recording.mcap_completion import complete_file
from ldt_core.recording.mcap_records import HEAD
from ldt_core.recording.message_subject import number_of
from ldt_core.recording.messages import DIAGNOSTICS, MULTI_ARRAY
from ldt_core.recording.metadata import TopicInformation
from ldt_core.recording.repair import repair
from ldt_core.recording.storage import Storage
from ldt_core.recording.writer import BagWriter

SMALL = 0.02  # MB; a few experiments of 200 samples, a chunk each
SETTINGS = {"threshold": 3.0, "model": "linear", "split_size": 5.0}


def experiment(number: int, length: int = 200) -> Experiment:
    random = np.random.default_rng(number)
    noise = random.normal(size=(2, length))
    return Experiment(number, 1e9 + number, 0.01, noise[0], noise[1])


def write(bag: BagWriter, numbers: range) -> None:
    for number in numbers:
        one = experiment(number)
        bag.write("experiment", one, one.end)
        bag.write("signal", Signal(number, Level.NEGATIVE, "lddm", 0, 0.1), one.end)
        bag.flush()


def information(folder: Path) -> dict:
    return yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


def killed(folder: Path, numbers: range, size: float = 0.0, **options: Any) -> Path:
    """A recording whose writer was killed right after it had written these experiments."""

    def record() -> None:
        bag = BagWriter(folder, "rotor", split_size=size, **options)
        write(bag, numbers)
        os.kill(os.getpid(), signal.SIGKILL)

    process = multiprocessing.get_context("fork").Process(target=record)
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    return folder


def last_chunk(data: bytes) -> tuple[int, int]:
    """Where the last whole chunk of a file begins and ends."""
    at, found = 8, (0, 0)
    while at + HEAD.size <= len(data):
        opcode, length = HEAD.unpack_from(data, at)
        end = at + HEAD.size + length
        if opcode == Opcode.CHUNK and end <= len(data):
            found = at, end
        at = end
    return found


def numbers(path: Path) -> list[int]:
    return [e.number for e in experiments(path).experiments]


def test_a_recording_goes_on_in_a_new_file_at_the_stated_size(tmp_path):
    """Named as rosbag2 names them; each is sound alone, together they hold all."""
    folder = tmp_path / "run"
    with BagWriter(folder, "rotor", topics=("experiment",), split_size=SMALL) as bag:
        write(bag, range(1, 31))
    files = [folder / f"run_{i}.mcap" for i in range(len(list(folder.glob("*.mcap"))))]
    assert len(files) > 3
    assert all(f.stat().st_size > SMALL * 1e6 for f in files[:-1])
    assert numbers(folder) == list(range(1, 31))
    assert [n for f in files for n in numbers(f)] == list(range(1, 31))
    assert inspect(read_bag(folder)).notes == []
    assert sorted(f.name for f in folder.iterdir()) == ["metadata.yaml", *[f.name for f in files]]


def test_the_metadata_counts_every_file_as_rosbag2_lists_them(tmp_path):
    """Paths, counts, starts and durations of each file and of all; `rosbags` reads the same."""
    highlevel = pytest.importorskip("rosbags.highlevel")
    folder = tmp_path / "run"
    with BagWriter(folder, "rotor", split_size=SMALL) as bag:
        write(bag, range(1, 31))
    told = information(folder)
    assert [f["path"] for f in told["files"]] == told["relative_file_paths"]
    assert sum(f["message_count"] for f in told["files"]) == told["message_count"] == 60
    for file in told["files"]:
        times = [raw.time_ns for raw in read_bag(folder / file["path"]).messages()]
        assert len(times) == file["message_count"]
        assert file["starting_time"] == {"nanoseconds_since_epoch": min(times)}
        assert file["duration"] == {"nanoseconds": max(times) - min(times)}
    with highlevel.AnyReader([folder]) as reader:
        assert reader.message_count == 60
        assert len(list(reader.messages())) == 60


def test_no_size_is_one_file(tmp_path):
    """Size 0 splits never."""
    with BagWriter(tmp_path / "run", "rotor", split_size=0) as bag:
        write(bag, range(1, 31))
    assert len(list((tmp_path / "run").glob("*.mcap"))) == 1


def test_many_small_chunks_begin_a_new_file_too(tmp_path, monkeypatch):
    """A slow machine makes a chunk of each message: the index of a file stays small then, too."""
    monkeypatch.setattr("ldt_core.recording.writer.MOST_CHUNKS", 5)
    monkeypatch.setattr("ldt_core.recording.writer.FLUSH_PERIOD", 60.0)  # by nobody but us
    with BagWriter(tmp_path / "run", "rotor") as bag:
        write(bag, range(1, 13))
    assert [f["message_count"] for f in information(tmp_path / "run")["files"]] == [10, 10, 4]


def test_the_metadata_of_a_killed_writer_is_right_about_all_complete_files(tmp_path):
    """The last one alone is counted as empty."""
    folder = killed(tmp_path / "run", range(1, 31), SMALL)
    *complete, last = information(folder)["files"]
    assert len(complete) > 2
    for file in complete:
        assert file["message_count"] == sum(1 for _ in read_bag(folder / file["path"]).messages())
    assert last["message_count"] == 0
    assert {f.name for f in folder.glob("*.mcap")} == {f["path"] for f in (*complete, last)}
    assert numbers(folder) == list(range(1, 31))


@pytest.mark.parametrize("size", [0.0, SMALL])
def test_a_recording_is_taken_up_where_its_writer_was_killed(tmp_path, size):
    """Nothing that was there is lost or written again; the whole is sound in the end."""
    folder = killed(tmp_path / "run", range(1, 21), size)
    before = {f.name for f in folder.glob("*.mcap")}
    with BagWriter(folder, "rotor", split_size=size, resume=True) as bag:
        assert bag.recorded("experiment").spans == [(1, 20)]
        assert bag.recorded("signal").spans == [(1, 20)]
        assert bag.recorded("adaptation").spans == []
        assert bag.counts == {"/experiment": 20, "/signal": 20}
        write(bag, range(21, 26))
        assert max(bag.recorded("/experiment")) == 25
    assert numbers(folder) == list(range(1, 26))
    assert len({f.name for f in folder.glob("*.mcap")} - before) >= 1
    assert inspect(read_bag(folder)).notes == []
    assert information(folder)["message_count"] == 50
    assert repair(folder).sound


@pytest.mark.slow
def test_the_end_that_a_killed_writer_left_out_is_what_it_would_have_written(tmp_path, monkeypatch):
    """Cut anywhere behind its last chunk, a file is given the very bytes that it had."""
    folder = tmp_path / "run"
    with BagWriter(folder, "rotor", topics=("model",), settings=SETTINGS) as bag:
        write(bag, range(1, 6))
    file = folder / "run_0.mcap"
    whole = file.read_bytes()
    custom = information(folder)["custom_data"]
    taken: list[str] = []

    def take(channel: Channel, schema: object, message: object) -> None:
        taken.append(channel.topic)

    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    for cut in range(last_chunk(whole)[1], len(whole), 17):
        file.write_bytes(whole[:cut])
        assert complete_file(file, custom, take)
        assert taken == ["/experiment", "/signal"] * 5
        assert file.read_bytes() == whole
        taken.clear()
    assert sorted(f.name for f in folder.iterdir()) == ["metadata.yaml", "run_0.mcap"]


def test_a_chunk_that_was_cut_off_is_kept_beside_and_told(tmp_path):
    """Its first bytes: nothing that was written goes away."""
    folder = killed(tmp_path / "run", range(1, 6))
    file = folder / "run_0.mcap"
    whole = file.read_bytes()
    begin, end = last_chunk(whole)
    file.write_bytes(whole[: end - 100])
    with BagWriter(folder, "rotor", resume=True) as bag:
        assert bag.recorded("experiment").spans == [(1, 4)]
        assert "has no end" in bag.mended[0]
        write(bag, range(5, 6))
    assert (folder / "run_0.mcap.tail").read_bytes() == whole[begin : end - 100]
    assert repair(folder).sound
    assert numbers(folder) == [1, 2, 3, 4, 5]


def test_an_index_that_finds_no_place_changes_nothing(tmp_path, monkeypatch):
    """The disk is full in the middle of it: the file is as it was, to the byte."""
    folder = killed(tmp_path / "run", range(1, 6))
    file = folder / "run_0.mcap"
    before = file.read_bytes()
    sync = os.fsync

    def full(descriptor: int) -> None:
        monkeypatch.setattr(os, "fsync", sync)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(LdtError, match="not repaired, and left unchanged: No space left"):
        BagWriter(folder, "rotor", resume=True)
    assert file.read_bytes() == before


def test_a_link_in_a_recording_is_not_followed(tmp_path):
    """What lies elsewhere is not LDT's to write to."""
    other = killed(tmp_path / "other", range(1, 3))
    before = (other / "other_0.mcap").read_bytes()
    folder = killed(tmp_path / "run", range(1, 3))
    (folder / "run_1.mcap").symlink_to(other / "other_0.mcap")
    with pytest.raises(LdtError, match=r"run_1.mcap: holds nothing"):
        BagWriter(folder, "rotor", resume=True)
    repair(folder)
    assert (other / "other_0.mcap").read_bytes() == before


def test_damage_before_the_end_has_a_file_written_anew(tmp_path):
    """A killed writer's file with a broken chunk in its middle, or its first one."""
    folder = killed(tmp_path / "run", range(1, 9))
    file = folder / "run_0.mcap"
    for begin in (600, len(file.read_bytes()) // 2):
        data = bytearray(file.read_bytes())
        data[begin : begin + 50] = bytes(50)
        file.write_bytes(data[: last_chunk(bytes(data))[1]])
        before = bytes(file.read_bytes())
        assert not complete_file(file, {}, lambda *message: None)
        assert file.read_bytes() == before
    with BagWriter(folder, "rotor", resume=True) as bag:
        held = bag.recorded("experiment").spans
        assert any("damaged" in note for note in bag.mended)
    assert (folder / "run_0.mcap.damaged").read_bytes() == before
    assert spans(numbers(folder)) == held
    assert repair(folder).sound


def test_an_index_that_is_damaged_or_missing_has_a_file_written_anew(tmp_path):
    """Behind a chunk that is not the last: stock readers find messages by it."""
    folder = killed(tmp_path / "run", range(1, 9))
    file = folder / "run_0.mcap"
    data = file.read_bytes()[: last_chunk(file.read_bytes())[1]]
    end = last_chunk(data[: last_chunk(data)[0]])[1]
    index = end + 20  # in the first entry
    flipped = data[:index] + bytes([data[index] ^ 4]) + data[index + 1 :]
    missing = data[:end] + data[last_chunk(data)[0] :]
    # And without the first chunk, which describes the channels.
    headless = data[: data.index(b"\x06")] + data[last_chunk(data)[0] :]
    for damaged in (flipped, missing, headless):
        file.write_bytes(damaged)
        assert not complete_file(file, {}, lambda *message: None)
        assert file.read_bytes() == damaged


def test_a_killed_writers_file_is_read_once_to_take_it_up(tmp_path, monkeypatch):
    """That takes seconds a gigabyte, in which nothing is recorded."""
    folder = killed(tmp_path / "run", range(1, 9))
    opened: list[str] = []
    real = mcap_records.content
    monkeypatch.setattr(mcap_records, "content", lambda body: opened.append("again") or real(body))
    monkeypatch.setattr(
        mcap_completion, "content", lambda body: opened.append("once") or real(body)
    )
    BagWriter(folder, "rotor", resume=True).close()
    assert opened == ["once"] * 8


def test_rare_messages_are_picked_without_reading_the_rest(tmp_path, monkeypatch):
    """By the index; without one, or where a chunk is damaged, all the same by reading it all."""
    folder = tmp_path / "run"
    models = [ModelRecord(version, "linear", (), {"a": 1.0}) for version in range(3)]
    with BagWriter(folder, "rotor", split_size=SMALL) as bag:
        for version, model in enumerate(models):
            write(bag, range(10 * version + 1, 10 * version + 11))
            bag.write("model", model, 1e9 + 100)
    opened: list[bytes] = []
    real = mcap_reader.opened
    monkeypatch.setattr(
        mcap_reader, "opened", lambda body, *rest: opened.append(body) or real(body, *rest)
    )
    expected = list(read_bag(folder).messages("model"))
    everything = len(opened)
    opened.clear()
    assert list(Storage(folder).picked(["/model"])) == expected
    assert len(expected) == 3
    assert len(opened) <= 3 < everything
    for file in folder.glob("*.mcap"):
        data = file.read_bytes()
        broken = bytearray(data)
        broken[data.index(b"\x06") + 60] ^= 1  # in the first chunk
        for damaged in (data[:-1], bytes(broken)):
            file.write_bytes(damaged)
            assert list(Storage(folder).picked(["/model"])) == [*read_bag(folder).messages("model")]
        file.write_bytes(data)


def test_a_recording_that_ended_in_order_is_taken_up_like_one_that_did_not(tmp_path):
    """Of one file or of several: its experiments are known."""
    for size in (0.0, SMALL):
        folder = tmp_path / f"run_{size}"
        with BagWriter(folder, "rotor", split_size=size) as bag:
            write(bag, range(1, 21))
        with BagWriter(folder, "rotor", split_size=size, resume=True) as bag:
            assert bag.recorded("experiment").spans == [(1, 20)]
            assert bag.mended == []


def test_a_recording_is_taken_up_again_and_again(tmp_path):
    """Killed in every part of it, which leaves nothing; also closed in order."""
    folder = tmp_path / "run"
    for part in range(4):
        killed(folder, range(5 * part + 1, 5 * part + 6), SMALL, resume=True)
    with BagWriter(folder, "rotor", resume=True) as bag:
        assert bag.recorded("experiment").spans == [(1, 20)]
    with BagWriter(folder, "rotor", resume=True) as bag:
        assert bag.recorded("experiment").spans == [(1, 20)]
        write(bag, range(21, 23))
    assert numbers(folder) == list(range(1, 23))
    assert repair(folder).sound
    listed = {f["path"] for f in read_bag(folder).storage.metadata["files"]}
    assert {file.name for file in folder.iterdir()} == {*listed, "metadata.yaml"}


def test_files_that_are_complete_are_not_read_to_take_a_recording_up(tmp_path):
    """Their experiments stand in metadata.yaml: a long recording is taken up as fast as a short."""
    folder = killed(tmp_path / "run", range(1, 31), SMALL)
    first = folder / "run_0.mcap"
    data = bytearray(first.read_bytes())
    data[5000:6000] = bytes(1000)
    first.write_bytes(data)
    with BagWriter(folder, "rotor", resume=True) as bag:
        assert bag.recorded("experiment").spans == [(1, 30)]
    assert not (folder / "run_0.mcap.damaged").exists()
    assert repair(folder).mended  # and here it is read
    with BagWriter(folder, "rotor", resume=True) as bag:
        assert len(bag.recorded("experiment")) < 30  # what was lost may come again


def test_a_recording_that_was_never_begun_is_begun(tmp_path):
    """No folder, an empty one, or files that their writer did not come to fill."""
    for made in ("none", "folder", "file"):
        folder = tmp_path / made
        if made != "none":
            folder.mkdir()
        if made == "file":
            BagWriter(tmp_path / "other", "rotor").close()
            (tmp_path / "other" / "metadata.yaml").rename(folder / "metadata.yaml")
            (folder / "file_0.mcap").touch()
        with BagWriter(folder, "rotor", resume=True) as bag:
            write(bag, range(1, 3))
        assert numbers(folder) == [1, 2]
        assert repair(folder).sound


def test_settings_are_kept_and_another_run_is_refused(tmp_path):
    """Another machine, another setting, a topic of another type, a folder of something else."""
    folder = killed(tmp_path / "run", range(1, 3), settings=SETTINGS)
    with BagWriter(folder, "rotor", resume=True):
        pass
    assert read_bag(folder).settings() == {"threshold": 3.0, "model": "linear"}
    same = {"split_size": 7.0, "model": "linear", "threshold": 3, "seed": 0}  # 0 is the default
    with BagWriter(folder, "rotor", settings=same, resume=True):
        pass
    with pytest.raises(RecordingError, match=r"run, threshold: expected 3.0, as in the rec"):
        BagWriter(folder, "rotor", settings={**SETTINGS, "threshold": 2.0}, resume=True)
    with pytest.raises(RecordingError, match="run: expected the recorded machine, rotor, got mill"):
        BagWriter(folder, "mill", resume=True)
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "to_mother.txt").write_text("dear")
    with pytest.raises(RecordingError):
        BagWriter(tmp_path / "letters", "rotor", resume=True)
    assert [f.name for f in (tmp_path / "letters").iterdir()] == ["to_mother.txt"]


def test_a_topic_of_another_type_or_quality_of_service_is_refused(tmp_path, monkeypatch):
    """What is recorded under one topic can be played as one."""
    folder = killed(tmp_path / "run", range(1, 3), topics=("signal",))
    text = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(text.replace("depth: 100", "depth: 7"))
    with pytest.raises(RecordingError, match="/signal: expected the recorded quality of service"):
        BagWriter(folder, "rotor", topics=("signal",), resume=True)
    (folder / "metadata.yaml").write_text(text)
    declared = {"type": MULTI_ARRAY}
    monkeypatch.setattr("ldt_core.recording.writer.declaration", lambda topic: declared)
    with pytest.raises(RecordingError, match=f"/signal: expected the recorded type {DIAGNOSTICS}"):
        BagWriter(folder, "rotor", topics=("signal",), resume=True)


@pytest.mark.slow
def test_metadata_of_any_kind_is_taken_or_refused_in_a_sentence(tmp_path, monkeypatch):
    """Lines of it lost, doubled or replaced: taken up, mended, or one of the project's errors."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    start = killed(tmp_path / "start", range(1, 5), settings=SETTINGS, topics=("experiment",))
    right = (start / "metadata.yaml").read_text().splitlines()
    place = random.Random(8)
    taken = 0
    for turn in range(80):
        lines = list(right)
        for _ in range(place.randrange(1, 4)):
            at = place.randrange(len(lines))
            name = lines[at].partition(":")[0]
            new = [[], [lines[at]] * 2, [f"{name}: 7"], [f"{name}: [a, {{}}]"], [f"{name}: {{}}"]]
            lines[at : at + 1] = place.choice(new)
        folder = tmp_path / f"run_{turn}"
        shutil.copytree(start, folder)
        (folder / "metadata.yaml").write_text("\n".join(lines) + "\n")
        with contextlib.suppress(LdtError):
            if turn % 2:
                repair(folder)
            with BagWriter(folder, "rotor", topics=("experiment",), resume=True) as bag:
                assert bag.recorded("experiment").spans == [(1, 4)]
            assert repair(folder).sound
            assert [f["message_count"] for f in information(folder)["files"]] == [8, 0]
            taken += 1
        shutil.rmtree(folder)
    assert taken > 20


def test_a_recording_that_is_being_written_belongs_to_its_writer(tmp_path):
    """Neither taken up nor mended by another; it is free when its writer has ended."""
    folder = tmp_path / "run"
    with BagWriter(folder, "rotor") as bag:
        write(bag, range(1, 3))
        for intruder in (lambda: BagWriter(folder, "rotor", resume=True), lambda: repair(folder)):
            with pytest.raises(RecordingError, match="one that is being written"):
                intruder()
        with pytest.raises(RecordingError, match="one that is being written"):
            repair(folder / "run_0.mcap")
    assert repair(folder).sound


def test_a_recording_that_is_let_go_meanwhile_can_be_taken(tmp_path):
    """A writer that was killed may take a moment to be gone."""
    holder = FolderLock(tmp_path)
    letting_go = threading.Timer(0.2, holder.release)
    letting_go.start()
    with FolderLock(tmp_path, patience=60) as lock:
        assert lock.held
        assert is_written(tmp_path)
    letting_go.join()
    assert not is_written(tmp_path)


def test_what_is_written_is_forced_onto_the_medium_in_time(tmp_path, monkeypatch):
    """Regularly, and all of it at the end; a medium that refuses stops the recording."""
    synced: list[int] = []
    done = threading.Event()

    def sync(descriptor: int) -> None:
        synced.append(os.fstat(descriptor).st_size)
        if len(synced) == 3:
            done.set()
            raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr("ldt_core.recording.writer.SYNC_PERIOD", 0.01)
    monkeypatch.setattr(os, "fdatasync", sync)
    bag = BagWriter(tmp_path / "run", "rotor")
    write(bag, range(1, 3))
    assert done.wait(60)
    with pytest.raises(LdtError, match="Input/output error; recording stopped after 4 messages"):
        bag.close()
    assert numbers(tmp_path / "run") == [1, 2]


def test_each_message_about_an_experiment_tells_its_number(tmp_path):
    """Out of the bytes, for every topic that has one; a model is about none."""
    one = experiment(7, length=3)
    records = {
        "experiment": one,
        "signal": Signal(7, Level.WARNING, "a detector", 3, 0.5, {"limit": 1.0}),
        "adaptation": Adaptation(7, Action.KEPT, 0, "so: experiment 8", {"a": 1.0}),
        "model": ModelRecord(4, "linear", (7,), {}),
    }
    for topic, record in records.items():
        expected = None if topic == "model" else 7
        for machine in ("", "m", "rotor", "long name"):  # texts of any length shift what follows
            data = encode_cdr(record, machine, 5.0)
            assert number_of(f"/m/{topic}", DECODERS[topic][0], data) == expected


@given(st.binary(max_size=200), st.sampled_from(sorted(DECODERS)))
def test_bytes_of_any_kind_have_a_number_or_none(data, topic):
    """Whoever publishes decides what is in them."""
    for head in (b"", b"\0\1\0\0", encode_cdr(experiment(3, length=2))[:40]):
        found = number_of(topic, DECODERS[topic][0], head + data)
        assert found is None or found >= 1


@given(st.lists(st.integers(1, 60)), st.lists(st.integers(1, 60)))
def test_numbers_are_a_set_in_stretches(first, then):
    """In any order, with any repetition, over a text and back."""
    held = ExperimentNumbers()
    for number in first:
        held.add(number)
    text = numbers_text({"/experiment": held}, 2) if first else ""
    found, files = parse_numbers(text)
    again = found.get("/experiment", ExperimentNumbers())
    assert files == (2 if first else 0)
    for number in then:
        again.add(number)
    everything = {*first, *then}
    assert again.spans == spans(everything)
    whole = set(range(min(everything, default=0), max(everything, default=-1) + 1))
    assert {n for a, b in again.gaps for n in range(a, b + 1)} == whole - everything
    assert list(again) == sorted(everything)
    assert len(again) == len(everything)
    assert all((n in again) == (n in everything) for n in range(62))


@pytest.mark.parametrize("text", [None, "", "{", "[]", "7", '{"files": -1, "numbers": {}}'])
def test_a_list_of_numbers_that_is_none_counts_as_nothing(text):
    """It comes from a file: all of the recording is read then."""
    assert parse_numbers(text) == ({}, 0)


@pytest.mark.parametrize("spans_", ["[[2, 1]]", '[["a", 2]]', "[[1]]", "7", "[[1, 2, 3]]", "[7]"])
def test_stretches_that_are_none_count_as_nothing(spans_):
    """The same."""
    assert parse_numbers(f'{{"files": 1, "numbers": {{"/experiment": {spans_}}}}}') == ({}, 0)


def test_the_disk_that_fails_at_a_split_stops_the_recording(tmp_path, monkeypatch):
    """The file before is complete; what follows is refused with the one reason."""
    bag = BagWriter(tmp_path / "run", "rotor", split_size=SMALL)
    (tmp_path / "run" / "run_1.mcap").mkdir()  # in the way of the second file
    with pytest.raises(LdtError, match="recording stopped after") as caught:
        write(bag, range(1, 31))
    with pytest.raises(LdtError, match="recording stopped after"):
        bag.close()
    written = int(str(caught.value).split("after ")[1].split()[0])
    (tmp_path / "run" / "run_1.mcap").rmdir()
    assert [f["path"] for f in information(tmp_path / "run")["files"]] == ["run_0.mcap"]
    assert sum(1 for _ in read_bag(tmp_path / "run").messages()) == written
    assert inspect(read_bag(tmp_path / "run")).notes == []


def test_topics_keep_their_order_in_every_file(tmp_path):
    """By which the channels of a damaged file are known."""
    with BagWriter(tmp_path / "run", "rotor", topics=("model",), split_size=SMALL) as bag:
        write(bag, range(1, 31))
    expected = ["/model", "/experiment", "/signal"]
    for file in (tmp_path / "run").glob("*.mcap"):
        assert list(read_bag(file).topics) == expected
    listed = information(tmp_path / "run")["topics_with_message_count"]
    assert [t["topic_metadata"]["name"] for t in listed] == expected
    assert TopicInformation("/model", DECODERS["model"][0]).entry() == listed[0]


def test_a_second_of_silence_between_files_is_none(tmp_path):
    """What is written while a file is completed is in the next: numbers go on without a gap."""
    until = time.monotonic() + 0.7  # the flusher's turns fall in between
    count = 0
    with BagWriter(tmp_path / "run", "rotor", split_size=SMALL) as bag:
        while time.monotonic() < until:
            count += 1
            one = experiment(count)
            bag.write("experiment", one, one.end)
    assert numbers(tmp_path / "run") == list(range(1, count + 1))
