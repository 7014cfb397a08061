"""Claims about recordings that something happened to: what is left is found, and nothing else.

Every fault is made on a recording's real bytes, or provoked in the process that writes them.
"""

from __future__ import annotations

import multiprocessing
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from ldt_core.base.errors import BadInput, LdtError, RecordingError
from ldt_core.base.experiment import Experiment, Level, Signal
from ldt_core.recording.bag import experiments, read_bag
from ldt_core.recording.experiment_numbers import ExperimentNumbers
from ldt_core.recording.health import inspect
from ldt_core.recording.mcap_reader import ChannelMessage, TolerantMcapReader
from ldt_core.recording.mcap_records import HEAD
from ldt_core.recording.messages import MULTI_ARRAY, STRING, schema, serialize, standard
from ldt_core.recording.repair import DAMAGED_SUFFIX, Repair, repair
from ldt_core.recording.storage import RawMessage, Storage
from ldt_core.recording.writer import BagWriter

pytestmark = pytest.mark.slow

NAME = "run_0.mcap"
CUTS = FLIPS = 250  # at random bytes
MENDED = 10  # of so many damaged files one is mended too, for the time that it takes
KILLS = 12
FILE_STEPS = ("open", "os.mkdir", "os.link", "os.rename", "os.remove")  # as Python audits them
NOBODY = 65534


class Whole(NamedTuple):
    """A sound recording, and where its messages lie.

    Args:
        folder: of it.
        data: bytes of its one file.
        messages: all of them.
        chunks: first byte, byte behind the last, messages in it; of each chunk.
        boundaries: where records begin.
    """

    folder: Path
    data: bytes
    messages: list[RawMessage]
    chunks: list[tuple[int, int, list[RawMessage]]]
    boundaries: list[int]


def experiment(number: int, length: int = 20) -> Experiment:
    noise = random.Random(number)
    rows = [[noise.gauss(0, 1) for _ in range(length)] for _ in range(2)]
    return Experiment(number, 1e9 + number, 0.01, *rows)


def write(bag: BagWriter, numbers: range, length: int = 20) -> None:
    for number in numbers:
        one = experiment(number, length)
        bag.write("experiment", one, one.end)
        bag.write("signal", Signal(number, Level.NEGATIVE, "lddm", 0, 0.1), one.end)
        if number % 2 == 0:
            bag.flush()


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Whole:
    folder = tmp_path_factory.mktemp("whole") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ldt_core.recording.writer.FLUSH_PERIOD", 3600.0)  # chunks as written below
        with BagWriter(folder, "rotor", topics=("experiment", "signal")) as bag:
            write(bag, range(1, 17))
    data = (folder / NAME).read_bytes()
    messages = list(read_bag(folder).messages())
    chunks, boundaries, at, taken = [], [], 8, 0
    while at < len(data) - 8:
        opcode, length = HEAD.unpack_from(data, at)
        boundaries.append(at)
        end = at + HEAD.size + length
        if opcode == Opcode.CHUNK:
            (folder.parent / "one.mcap").write_bytes(data[:end])
            count = sum(1 for _ in TolerantMcapReader(folder.parent / "one.mcap", list).messages())
            chunks.append((at, end, messages[taken:count]))
            taken = count
        at = end
    assert taken == len(messages) == 32
    assert len(chunks) >= 8
    return Whole(folder, data, messages, chunks, boundaries)


@pytest.fixture
def unsynced(monkeypatch):
    """Without waiting for the medium: thousands of repairs are made."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


def copy(whole: Whole, folder: Path, data: bytes) -> Path:
    """The recording with other bytes in its file."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    shutil.copy(whole.folder / "metadata.yaml", folder)
    (folder / NAME).write_bytes(data)
    return folder


def read(folder: Path) -> tuple[list[RawMessage], list[str]]:
    """Messages, and what was said of damage."""
    storage = Storage(folder)
    return list(storage.messages()), storage.notes


def mended(folder: Path, data: bytes, expected: list[RawMessage]) -> Repair:
    """Mend the recording; what was found in it before is what is in it now, and is sound."""
    work = repair(folder)
    found, notes = read(folder)
    assert found == expected
    assert notes == []
    assert Storage(folder).metadata["message_count"] == len(expected)
    if work.mended:
        assert (folder / (NAME + DAMAGED_SUFFIX)).read_bytes() == data
        assert sum(work.mended[0].recovered.values()) == len(expected)
    else:
        assert (folder / NAME).read_bytes() == data
    return work


def cut_places(whole: Whole) -> list[int]:
    place = random.Random(2)
    anywhere = [place.randrange(len(whole.data)) for _ in range(CUTS)]
    return sorted({*whole.boundaries, *anywhere})


def test_a_file_cut_anywhere_gives_every_chunk_before_the_cut(whole, tmp_path, unsynced):
    """At every record's and chunk's boundary and at 250 random bytes, read; a part is mended."""
    chunk_ends = [end for _, end, _ in whole.chunks]
    for turn, at in enumerate(cut_places(whole)):
        folder = copy(whole, tmp_path / "run", whole.data[:at])
        expected = [m for _, end, held in whole.chunks if end <= at for m in held]
        try:
            found, notes = read(folder)
        except RecordingError:
            assert at < 8  # too little to be taken for a recording
            continue
        assert found == expected, at
        assert any("has no end" in n or "index is damaged" in n for n in notes), at
        if turn % MENDED == 0 or at in chunk_ends:
            mended(folder, whole.data[:at], expected)


def test_a_flipped_bit_is_noticed_and_costs_its_chunk_at_most(whole, tmp_path, unsynced):
    """At 250 random bytes: always told, every other chunk is there; a part is mended."""
    place = random.Random(3)
    lost = 0
    for turn in range(FLIPS):
        at = place.randrange(len(whole.data))
        data = bytearray(whole.data)
        data[at] ^= 1 << place.randrange(8)
        folder = copy(whole, tmp_path / "run", bytes(data))
        untouched = [m for begin, end, held in whole.chunks if not begin <= at < end for m in held]
        found, notes = read(folder)
        assert notes, at
        assert found in (untouched, whole.messages), at
        lost += len(found) < len(whole.messages)
        if turn % MENDED:
            continue
        work = mended(folder, bytes(data), found)
        missing = sum(sum(file.missing.values()) for file in work.mended)
        assert missing == len(whole.messages) - len(found), at
    assert lost > FLIPS / 10


def test_a_bit_flipped_in_the_kind_of_a_record_makes_no_message(whole, tmp_path):
    """There is no checksum on it: an index is not taken for a message, nor the file's header."""
    file = tmp_path / NAME
    for at in whole.boundaries:
        for bit in range(8):
            data = bytearray(whole.data)
            data[at] ^= 1 << bit
            file.write_bytes(data)
            untouched = [m for begin, _, held in whole.chunks if begin != at for m in held]
            found, notes = read(file)
            assert notes, (at, bit)
            assert found in (untouched, whole.messages), (at, bit)


def test_damage_of_any_size_costs_the_chunks_that_it_touches(whole, tmp_path, unsynced):
    """Up to half of the file overwritten with anything; and with the file's end lost as well."""
    place = random.Random(4)
    for turn in range(200):
        begin = place.randrange(8, len(whole.data))
        size = place.randrange(1, len(whole.data) // 2)
        data = bytearray(whole.data)
        filler = place.choice([bytes(size), place.randbytes(size)])
        data[begin : begin + size] = filler[: len(data) - begin]
        if turn % 2:
            data = data[: place.randrange(begin, len(data) + 1)]
        folder = copy(whole, tmp_path / "run", bytes(data))
        untouched = [
            m
            for first, end, held in whole.chunks
            if (end <= begin or first >= begin + size) and end <= len(data)
            for m in held
        ]
        found, notes = read(folder)
        assert notes
        assert found == untouched
        mended(folder, bytes(data), found)


def test_the_first_chunk_lost_in_a_file_without_an_end_costs_no_other(whole, tmp_path):
    """It describes the channels; metadata.yaml has them too."""
    begin, end, _ = whole.chunks[0]
    data = bytearray(whole.data[: whole.chunks[-1][1]])
    data[begin + 50 : end] = bytes(end - begin - 50)
    folder = copy(whole, tmp_path / "run", bytes(data))
    found, notes = read(folder)
    assert found == [m for _, _, held in whole.chunks[1:] for m in held]
    assert notes
    work = mended(folder, bytes(data), found)
    assert work.mended[0].missing == {"/experiment": 2, "/signal": 2}


def test_metadata_that_is_lost_comes_back_from_the_files(whole, tmp_path):
    """Machine and settings stand at the end of a complete file; a damaged one is kept."""
    folder = tmp_path / "run"
    with BagWriter(folder, "rotor", settings={"threshold": 2.5}) as bag:
        write(bag, range(1, 5))
    right = (folder / "metadata.yaml").read_text()
    for text in (None, "", "rosbag2_bagfile_information: [1, 2", right[:500]):
        (folder / "metadata.yaml").unlink()
        if text is not None:
            (folder / "metadata.yaml").write_text(text)
        work = repair(folder)
        assert work.metadata == "it was missing or damaged"
        assert not work.mended
        assert (folder / "metadata.yaml").read_text() == right
        assert read_bag(folder).settings() == {"threshold": 2.5}
        if text:
            (folder / ("metadata.yaml" + DAMAGED_SUFFIX)).rename(tmp_path / "kept")
            assert (tmp_path / "kept").read_text() == text
        assert repair(folder).sound


def test_a_sound_recording_is_not_touched(whole, tmp_path):
    """Not a byte, not a time of change, in a folder or bare."""
    folder = copy(whole, tmp_path / "run", whole.data)
    before = {f: (f.read_bytes(), f.stat().st_mtime_ns) for f in folder.iterdir()}
    assert repair(folder).sound
    assert repair(folder / NAME).sound
    (folder / NAME).rename(tmp_path / NAME)
    assert repair(tmp_path / NAME).sound
    (tmp_path / NAME).rename(folder / NAME)
    assert {f: (f.read_bytes(), f.stat().st_mtime_ns) for f in folder.iterdir()} == before


def test_a_bare_file_is_mended_beside_itself(whole, tmp_path):
    """Without a folder of its own there is no metadata.yaml to write."""
    data = whole.data[: whole.chunks[5][1] + 7]
    (tmp_path / NAME).write_bytes(data)
    work = repair(tmp_path / NAME)
    assert [f.name for f in sorted(tmp_path.iterdir())] == [NAME, NAME + DAMAGED_SUFFIX]
    assert work.mended[0].kept.read_bytes() == data
    assert read(tmp_path / NAME) == ([m for _, _, held in whole.chunks[:6] for m in held], [])


def test_a_second_repair_keeps_what_the_first_one_kept(whole, tmp_path):
    """Damaged again later: each original has its own name."""
    folder = copy(whole, tmp_path / "run", whole.data[: whole.chunks[5][1]])
    repair(folder)
    again = (folder / NAME).read_bytes()[:-20]
    (folder / NAME).write_bytes(again)
    assert repair(folder).mended[0].kept.name == NAME + DAMAGED_SUFFIX + ".2"
    assert (folder / (NAME + DAMAGED_SUFFIX)).read_bytes() == whole.data[: whole.chunks[5][1]]
    assert (folder / (NAME + DAMAGED_SUFFIX + ".2")).read_bytes() == again


@pytest.mark.parametrize("offered", ["- a: 1", "2001-99-99", "*none"])
def test_other_programs_files_are_mended_as_they_are(tmp_path, offered):
    """Types that LDT does not know, their definitions, encodings and times, byte by byte."""
    file = tmp_path / "x.mcap"
    with file.open("wb") as stream:
        writer = Writer(stream, chunk_size=100, compression=CompressionType.LZ4)
        writer.start("ros2", library="another")
        known = writer.register_schema(STRING, "ros2msg", schema(STRING)[0].encode())
        odd = writer.register_schema("odd/msg/Odd", "ros2idl", b"whatever they say")
        words = writer.register_channel("/words", "cdr", known, {"offered_qos_profiles": offered})
        odds = writer.register_channel("/odds", "odd", odd)
        bare = writer.register_channel("/bare", "json", 0)
        for n in range(30):
            text = serialize(standard().String(data=f"word {n}"))
            writer.add_message(words, 100 + n, text, 90 + n, n)
            writer.add_message(odds, 100 + n, bytes([n] * 9), 80 + n, 7)
            writer.add_message(bare, 100 + n, b"{}", n)
        writer.finish()

    def everything() -> list[tuple]:
        notes: list[str] = []
        return [
            (c.topic, c.message_encoding, c.metadata, s and (s.name, s.encoding, s.data), m)
            for c, s, m in TolerantMcapReader(file, notes.append).messages()
        ]

    file.write_bytes(file.read_bytes()[:-40])
    before = everything()
    assert len(before) == 90
    work = repair(file)
    assert work.mended[0].recovered == {"/words": 30, "/odds": 30, "/bare": 30}
    assert everything() == before
    assert repair(file).sound


def test_files_that_are_missing_or_of_another_format_are_told(whole, tmp_path):
    """What cannot be mended is said, and the list keeps the name of what may come back."""
    folder = copy(whole, tmp_path / "run", whole.data)
    text = (folder / "metadata.yaml").read_text()
    listed = text.replace(f"  - {NAME}\n", f"  - {NAME}\n  - run_1.mcap\n")
    (folder / "metadata.yaml").write_text(listed)
    work = repair(folder)
    assert work.unmended == [f"{folder}: metadata.yaml lists run_1.mcap, which is missing"]
    assert "run_1.mcap" in (folder / "metadata.yaml").read_text()
    (folder / "run_1.mcap").write_text("a letter")
    assert any("run_1.mcap: holds nothing" in sentence for sentence in repair(folder).unmended)


def forked(work: Callable[[], None], until: Callable[[], object] = lambda: None) -> int:
    """Exit code of a process that does this.

    Args:
        work: what it does.
        until: waits for the moment at which it is killed, if it ends; None where it is left to end.
    """
    process = multiprocessing.get_context("fork").Process(target=work)
    process.start()
    if until() is not None:
        process.kill()
    process.join()
    assert process.exitcode is not None
    return process.exitcode


def killed_at_file_step(work: Callable[[], object], step: int) -> bool:
    """Do it in a process that is killed before its so many-th opening, renaming, removing, linking.

    Returns:
        False where it had ended before.
    """

    def run() -> None:
        left = step

        def hook(event: str, arguments: object) -> None:
            nonlocal left
            left -= event in FILE_STEPS
            if left == -1:
                left -= 1  # the kill itself is audited, too
                os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(hook)
        work()
        os._exit(0)

    code = forked(run)
    assert code in (0, -signal.SIGKILL)
    return code != 0


def test_a_writer_killed_at_any_moment_loses_nothing_that_was_flushed(tmp_path):
    """Between two bytes, in a flush, in a split: `flush` has returned, so it is there."""
    folder = tmp_path / "run"
    told, tell = os.pipe()

    def record() -> None:
        with BagWriter(folder, "rotor", split_size=0.005, resume=True) as bag:
            number = max(bag.recorded("experiment"), default=0)
            while True:
                number += 1
                one = experiment(number)
                bag.write("experiment", one, one.end)
                bag.flush()
                os.write(tell, number.to_bytes(4, "little"))

    place = random.Random(5)
    flushed = 0

    def so_many() -> bool:
        nonlocal flushed
        for _ in range(place.randrange(1, 40)):
            flushed = int.from_bytes(os.read(told, 4), "little")
        time.sleep(place.uniform(0, 0.003))
        return True

    for _ in range(KILLS):
        assert forked(record, so_many) == -signal.SIGKILL
        os.write(tell, bytes(4))
        while number := int.from_bytes(os.read(told, 4), "little"):
            flushed = number
        found = [e.number for e in experiments(folder).experiments]
        assert found == list(range(1, len(found) + 1))
        assert len(found) - flushed in (0, 1)  # that one was flushed, and there was no time to tell
    repair(folder)
    assert repair(folder).sound
    assert inspect(read_bag(folder)).notes == []


@pytest.mark.parametrize("begun", [False, True])
def test_a_writer_killed_before_any_of_its_steps_can_be_followed(tmp_path, unsynced, begun):
    """In making the folder, in a split, in closing; and in taking up what a killed one left."""
    folder, start = tmp_path / "run", tmp_path / "start" / "run"

    def record() -> None:
        run = {"settings": {"threshold": 2.5}, "split_size": 0.003}
        with BagWriter(folder, "rotor", resume=True, **run) as bag:
            write(bag, range((max(bag.recorded("experiment"), default=0)) + 1, 9), 40)

    def reset() -> None:
        shutil.rmtree(folder, ignore_errors=True)
        if begun:
            shutil.copytree(start, folder)

    if begun:
        steps = 0
        while not (folder / "run_1.mcap").exists() and killed_at_file_step(record, steps):
            steps += 1
        shutil.copytree(folder, start)
        assert not repair(folder).sound
    step = 0
    reset()
    while killed_at_file_step(record, step):
        record()
        found = experiments(folder)
        assert [e.number for e in found.experiments] == list(range(1, 9)), step
        assert found.notes == [], step
        assert repair(folder).sound, step
        assert read_bag(folder).settings() == {"threshold": 2.5}, step
        step += 1
        reset()
    assert step > 10


def test_a_repair_killed_before_any_of_its_steps_leaves_all_there_is(whole, tmp_path, unsynced):
    """The file is the damaged one or the mended one; the next repair ends the work."""
    data = whole.data[: whole.chunks[-2][1] + 30]
    expected = [m for _, _, held in whole.chunks[:-1] for m in held]
    folder = copy(whole, tmp_path / "run", data)
    step = 0
    while killed_at_file_step(lambda: repair(folder), step):
        assert read(folder)[0] == expected
        repair(folder)
        assert read(folder) == (expected, [])
        assert data in [f.read_bytes() for f in folder.glob("*" + DAMAGED_SUFFIX + "*")]
        assert not list(folder.glob("*.mending"))
        assert repair(folder).sound
        copy(whole, folder, data)
        step += 1
    assert step > 10
    assert read(folder) == (expected, [])


DISK = textwrap.dedent(
    """
    import sys
    from contextlib import suppress
    from pathlib import Path
    sys.path.insert(0, sys.argv[1])
    from test_recording_faults import *
    disk = Path(sys.argv[2])
    folder = disk / "run"
    bag = BagWriter(folder, "rotor")
    said = []
    for number in range(1, 2000):
        try:
            write(bag, range(number, number + 1), 500)
        except LdtError as error:
            said.append(str(error))
            if len(said) > 3:
                break
    try:
        bag.close()
    except LdtError as error:
        said.append(str(error))
    assert len(said) == 5 and len(set(said)) == 1, said
    assert "the disk is full; recording stopped after" in said[0], said
    before = {f.name: f.read_bytes() for f in folder.iterdir()}
    kept = [e.number for e in experiments(folder).experiments]
    assert kept == list(range(1, len(kept) + 1)) and len(kept) > 100
    try:
        repair(folder)
    except LdtError as error:
        assert error.exit_code == 1, error
        assert "not repaired, and left unchanged: " in str(error), error
    else:
        raise AssertionError("mended without a place to write to")
    assert {f.name: f.read_bytes() for f in folder.iterdir()} == before
    with suppress(LdtError), BagWriter(folder, "rotor", resume=True) as bag:
        assert list(bag.recorded("experiment")) == kept  # an index may still find its place
    assert [e.number for e in experiments(folder).experiments] == kept
    (disk / "filler_2").write_bytes(b"")
    with suppress(OSError), (disk / "filler_2").open("wb", buffering=0) as filler:
        while True:
            filler.write(bytes(100))
    try:
        BagWriter(disk / "other", "rotor")
    except RecordingError as error:
        assert "place to write a recording, got No space left" in str(error), error
    else:
        raise AssertionError("begun without a place to write to")
    assert not (disk / "other").exists()
    (disk / "filler").unlink()
    with BagWriter(folder, "rotor", resume=True) as bag:
        assert list(bag.recorded("experiment")) == kept
    assert repair(folder).sound
    assert [e.number for e in experiments(folder).experiments] == kept
    print("as it should be")
    """
)


def test_a_disk_that_is_full_costs_what_came_after(tmp_path):
    """A file system of 8 MB: all that was flushed is there, and it goes on when there is room."""
    mount = f"mount -t tmpfs -o size=8m none {tmp_path}"
    fill = f"head -c 5M /dev/urandom > {tmp_path}/filler"
    code = f'{mount} && {fill} && exec "$@"'
    command = ["unshare", "--mount", "--map-root-user", "sh", "-c", code, "sh"]
    if subprocess.run([*command, "true"], capture_output=True, check=False).returncode:
        pytest.skip("no file system can be mounted here")
    done = subprocess.run(
        [*command, sys.executable, "-c", DISK, str(Path(__file__).parent), str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("as it should be\n", "")


def test_a_file_that_grows_meanwhile_is_left_alone(whole, tmp_path, monkeypatch):
    """Another program's recorder knows nothing of LDT's lock: what it writes is not lost."""
    data = whole.data[: whole.chunks[5][1]]
    folder = copy(whole, tmp_path / "run", data)
    messages = TolerantMcapReader.messages

    def and_more(self: TolerantMcapReader) -> Iterator[ChannelMessage]:
        yield from messages(self)
        with (folder / NAME).open("ab") as stream:
            stream.write(b"more")

    monkeypatch.setattr(TolerantMcapReader, "messages", and_more)
    with pytest.raises(RecordingError, match="a file that nobody is writing, got one that has ch"):
        repair(folder)
    assert (folder / NAME).read_bytes().startswith(data + b"more")
    assert sorted(f.name for f in folder.iterdir()) == ["metadata.yaml", NAME]


def test_a_file_that_may_not_grow_is_not_mended(whole, tmp_path):
    """The process's limit on file sizes, in the middle of a repair: all is as it was."""
    data = whole.data[: whole.chunks[-1][1]]
    folder = copy(whole, tmp_path / "run", data)

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))
        with pytest.raises(LdtError, match="not repaired, and left unchanged: File too large"):
            repair(folder)

    assert forked(limited) == 0
    assert (folder / NAME).read_bytes() == data
    assert sorted(f.name for f in folder.iterdir()) == ["metadata.yaml", NAME]


def test_a_folder_that_may_not_be_written_can_be_read_and_says_so(whole, tmp_path):
    """A sound recording there is sound, a damaged one is read, and refused to be mended."""
    data = whole.data[: whole.chunks[5][1]]
    folder = copy(whole, tmp_path / "run", data)
    sound = copy(whole, tmp_path / "sound", whole.data)
    expected = [m for _, _, held in whole.chunks[:6] for m in held]
    tops = [p for p in tmp_path.parents if p.stat().st_uid == os.getuid() and p != Path("/")]

    def as_nobody() -> None:
        if os.getuid() == 0:
            os.setgid(NOBODY)
            os.setuid(NOBODY)
        if not os.access(folder, os.R_OK):
            os._exit(77)
        assert repair(sound).sound
        assert read(folder)[0] == expected
        with pytest.raises(RecordingError, match="that may be written, got Permission denied"):
            repair(folder)
        with pytest.raises(RecordingError, match="Permission denied"):
            BagWriter(folder, "rotor", resume=True)
        with pytest.raises(RecordingError, match="place to write a recording, got Permission"):
            BagWriter(folder / "inside", "rotor")

    modes = {p: p.stat().st_mode for p in (folder, sound, tmp_path, *tops)}
    try:
        for path in (folder, sound):
            path.chmod(0o555)
        for path in (tmp_path, *tops):
            path.chmod(modes[path] | 0o055)
        code = forked(as_nobody)
    finally:
        for path, mode in modes.items():
            path.chmod(mode)
    if code == 77:
        pytest.skip("nobody may not come here")
    assert code == 0
    assert (folder / NAME).read_bytes() == data


def test_random_bytes_behind_the_magic_are_no_recording(tmp_path):
    """Whatever they claim of lengths and counts: one sentence, or a sound recording of nothing."""
    place = random.Random(7)
    file = tmp_path / "x.mcap"
    for _ in range(300):
        records = b"".join(
            HEAD.pack(place.randrange(16), place.choice([0, 4, 20, 30, 2**62]))
            + place.randbytes(place.randrange(60))
            for _ in range(place.randrange(6))
        )
        file.write_bytes(b"\x89MCAP0\r\n" + records)
        for work in (read, experiments):
            try:
                found = work(file)
            except BadInput:
                continue
            assert found[0] == []


def test_a_chunk_of_an_unknown_kind_is_told(whole, tmp_path):
    """Another application's record is not LDT's to judge, and not silently left out."""
    at = whole.chunks[3][0]
    extra = HEAD.pack(0x90, 5) + b"hello"
    folder = copy(whole, tmp_path / "run", whole.data[:at] + extra + whole.data[at:])
    found, notes = read(folder)
    assert found == whole.messages
    assert any("another application" in note for note in notes)


def test_the_types_are_the_files_own(whole):
    """What the faults above are made on: two topics, and their numbers known from the bytes."""
    assert {m.kind for m in whole.messages} == {MULTI_ARRAY, "diagnostic_msgs/msg/DiagnosticArray"}
    held = ExperimentNumbers()
    for one in read_bag(whole.folder).experiments():
        held.add(one.number)
    assert held.spans == [(1, 16)]


@pytest.mark.parametrize("then", ["cut", "swapped"])
def test_metadata_that_is_not_this_recordings_is_told_as_that(then, tmp_path):
    """The files are read all the same."""
    for name in ("mine", "other"):
        with BagWriter(tmp_path / name, "rotor") as writer:
            one = Experiment(1, 1e9, 0.01, np.zeros(5), np.zeros(5))
            writer.write("experiment", one, one.end)
    mine = tmp_path / "mine" / "metadata.yaml"
    text = mine.read_text() if then == "cut" else (tmp_path / "other" / "metadata.yaml").read_text()
    mine.write_text(text[:200] if then == "cut" else text)
    bag = read_bag(tmp_path / "mine")
    assert len(list(bag.experiments())) == 1
    words = {
        "cut": "metadata.yaml is cut off or damaged; the files tell the rest",
        "swapped": "metadata.yaml is of another recording: "
        "it lists other_0.mcap, and not mine_0.mcap",
    }
    assert bag.notes == [f"{tmp_path / 'mine'}: {words[then]}"]


def test_a_link_that_leads_nowhere_is_told_as_that(tmp_path):
    """It said that there is no such file, and asked whether the file itself was meant."""
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(BadInput, match="got a link that leads nowhere"):
        read_bag(tmp_path / "loop")
