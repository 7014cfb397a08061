"""What people get wrong first, and the next step that the one sentence names."""

from __future__ import annotations

import json
import shlex
import shutil
import struct
import time
from pathlib import Path

import numpy as np
import pytest

from ldt_core.base.experiment import Experiment
from ldt_core.cli import invoke, ldt, progress
from ldt_core.cli.outputs import replacing
from ldt_core.recording.messages import serialize, standard
from ldt_core.recording.writer import BagWriter

RUN = Path(__file__).resolve().parents[2] / "bags" / "rotor_drift"


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A motor's recording, a foreign one, a table, a result and a folder of a user's own."""
    folder = tmp_path_factory.mktemp("files")
    still = np.zeros(60)
    with BagWriter(folder / "motor", machine="dc_motor") as writer:
        writer.write("experiment", Experiment(1, 1e9, 0.01, still + 10.0, still), 1e9)
    with BagWriter(folder / "foreign") as writer:
        name = serialize(standard().String(data="press"))
        writer.write_raw("/press/name", "std_msgs/msg/String", name, 1)
        number = bytes([0, 1, 0, 0]) + struct.pack("<d", 6.0)  # CDR, little endian
        writer.write_raw("/press/command", "std_msgs/msg/Float64", number, 1)
    rows = "".join(f"{t},{t % 7},{t % 5}\n" for t in range(50))
    (folder / "log.csv").write_text(f"time_ms,u,rpm\n{rows}")
    words = "Zeit;Spannung;Drehzahl\n[ms];[V];[U/min]\n"
    (folder / "plc.csv").write_text(words + rows.replace(",", ",0;"))
    (folder / "two.csv").write_text("drive,speed\n0,1\n5,3\n0,2\n")
    (folder / "bare.csv").write_text(rows)
    (folder / "german.csv").write_text(f"Zeit,Spannung,Drehzahl\n{rows}")
    (folder / "excel.csv").write_bytes(b"\xef\xbb\xbfZeit;U\r\n0;1\r\n")
    (folder / "preamble.csv").write_text("Messung 12;;\nt;u;n\n0;1;2\n1;1;2\n")
    (folder / "points.csv").write_text("t;u;n\n0,5;1;2,5\n1,0;1;1.002,5\n")
    (folder / "book.xlsx").write_bytes(b"PK\x03\x04\x00\x00")
    (folder / "found.json").write_text('{"verdict": {"kind": "none"}}')
    with BagWriter(folder / "nameless") as writer:
        writer.write("experiment", Experiment(1, 1e9, 0.01, still + 10.0, still), 1e9)
    (folder / "done").mkdir()
    (folder / "done" / "diagnosis.json").write_text("{}")
    (folder / "page.html").write_text("mine")
    (folder / "mine").mkdir()
    (folder / "mine" / "precious.txt").write_text("mine")
    return folder


#: What is typed → what the sentence has to name as the way on.
WRONG = {
    "diagnose {files}/foreign --out why": "ldt import makes one",
    "replay {files}/motor --machine rotor --out out": "leave --machine out",
    "run --duration 10": "stands in the machine file",
    "tune {files}/motor --out out": "expected a budget: --adaptations 10",
    "import {files}/log.csv --voltage u --speed rpm:rpm --out x": "--time time_ms:ms --out",
    "import {files}/two.csv --out x": "--sample-period SECONDS",
    "identify {files}/motor --machine dc_motor --out out.yaml": "ldt calibrate RECORDING --machine",
    "run --experiment 4": "did you mean '--experiments'?",
    "diagnos {files}/motor": "did you mean 'diagnose'?",
    "simulate --effect unbalance:e=5 --out out": "5mm is 0.005 m",
    "import {files}/log.csv --voltage u --speed rpm --time time_ms --out out": "rpm:rpm",
    "import {files}/log.csv --out out": "--speed rpm:rpm --time time_ms:ms",
    "import {files}/log.csv --speed rpm:rpm --out out": "'time_ms', 'u', 'rpm'",
    "import {files}/foreign --speed /press/name.data --out out": "ldt info",
    "import {files}/plc.csv --voltage Spannung --speed Drehzahl --time Zeit:ms --out out": (
        "Drehzahl:U/min or Drehzahl:rad/s"
    ),
    "import {files}/german.csv --voltage Spannung --speed Drehzahl --time Zeit --length 1 -o x": (
        "if they are ms: --time Zeit:ms"
    ),
    "import {files}/german.csv -o x": "--speed Drehzahl:UNIT --time Zeit:UNIT",
    "import {files}/bare.csv --voltage u --speed n --time t --out out": "a number from 1 to 3",
    "import {files}/mine --voltage u --speed n --time t --out out": "expected .mcap files",
    "diagnose {files}/log.csv --machine rotor --out out": "ldt info says how",
    "diagnose {files}/nameless --out out": "ldt identify",
    "simulate --effect unblance:e=5mm --out out": "names (did you mean 'unbalance'?)",
    "import {files}/log.csv --voltage u --speed rpm:rmp --time u --out out": "did you mean 'rpm'?",
    "report {files}/motor": "'-o' / '--out' is missing, as in: ldt report my_run -o",
    "info {files}/motr": "(did you mean '{files}/motor'?)",
    "info {files}/page.html": "expected a recording or a table",
    "run {files}/motor": "--play {files}/motor",
    "plot {files}/motor {files}/motor -o out.png": "too many arguments",
    "run --noise 5% --out out": "--noise: expected a number, without a unit, got '5%'",
    "run --experiments 4,5": "--experiments: expected a whole number",
    "import {files}/log.csv -voltage u --out out": "did you mean '--voltage'?",
    "help run": "ldt run --help",
    "help": "ldt --help",
    "diagnose {files}/motor --machine {files}/nameless --out out": "got a folder",
    "diagnose {files}/motor --machine {files}/page.yml --out out": (
        "(did you mean '{files}/page.html'?)"
    ),
    "diagnose": "is missing, as in: ldt diagnose",
    "run --model hybrid --order 2": "--model linear or --model auto",
    "run --play {files}/motor --noise 1": "left out: it has no effect with --play",
    "report {files}/motor -o run.html": "ldt replay makes one",
    "diagnose {files}/motor --out {files}/done": "--force",
    f"report {RUN} -o {{files}}/page.html": "--force",
    "simulate --out {files}/mine": "--force",
    "simulate --out {files}/mine --force": "that ldt has written",
    "replay {files}/motor --out {files}/motor --force": "another recording",
    "identify {files}/motor -o motor.yaml": "ldt calibrate (ldt docs connect)",
    "run --resume {files}/motor --force": "left out with --resume",
    "run --resume {files}/nameless": "lets a twin learn on it",
    "report {files}/done/diagnosis.json -o run.html": "--with takes a diagnosis",
    "diagnose {files}/motor press.yaml --out out": "--machine press.yaml",
    "predict {files}/motor press.yaml -o out": "--machine press.yaml",
    "import {files}/motor --voltage u --speed n --out out": "ldt info {files}/motor",
    "import {files}/foreign --voltage u --speed n --out out": "ldt info lists the topics",
    "diagnose {files}/excel.csv --machine rotor --out out": "ldt info says how to import a table",
    "predict {files}/motor --machine dc_motor --with {files}/log.csv -o out": "diagnose writes",
    "advise": "a run's recording, or a machine: --machine",
    "advise --machine rotor --reach 0": "--reach: expected a finite speed above 0 rad/s",
    "advise --machine rotor --reach 900": "a speed that 24 V can hold",
    "diagnose {files}/motor --machine {files}/found.json -o out": "a diagnosis follows --with",
    "simulate --effect 'unbalance e=5mm' -o out": "NAME:param=value, as in unbalance:e=0.008",
    "simulate --effect unbalance=5mm -o out": "NAME:param=value, as in unbalance:e=0.008",
    "simulate --effect unbalance:e=0,005 -o out": "with decimal points, got '005'",
    "import {files}/book.xlsx --voltage u --speed n --time t -o out": "export it as CSV",
    "info {files}/book.xlsx": "export it as CSV",
    "import {files}/points.csv --voltage u --speed n --time t -o out": "no thousands separators",
    "import {files}/preamble.csv --voltage u --speed n --time t -o out": (
        "delete the lines above the row of names"
    ),
    "import {files}/preamble.csv -o out": "delete the lines above the row of names",
    "run --play {files}/motor --play {files}/nameless": "--play: expected one file",
    "run --bag here -o there": "--out: expected one file or folder, got 2",
    "doctor --bag here --bag there": "--bag: expected one file or folder, got 2",
    "challenge make --out here --out there": "--out: expected one file or folder, got 2",
    "learning of": "expected one of 'on', 'off', got 'of'",
    "watch {files}/motor --port 99999": "--port: expected 0 to 65535, got 99999",
    "import {files}/log.csv --voltage u --speed rpm:Umdrehungen --time time_ms:ms -o out": "'rpm'",
    "predict {files}/motor --machine dc_motor --with dc_motor -o out": "diagnose writes",
}


@pytest.mark.parametrize(("line", "step"), WRONG.items(), ids=list(WRONG))
def test_a_wrong_usage_is_told_the_next_step(line, step, files, tmp_path, monkeypatch, capsys):
    """One sentence on standard error, no file touched, no folder left."""
    monkeypatch.chdir(tmp_path)
    before = sorted((p, p.stat().st_mtime_ns) for p in files.rglob("*"))
    code = invoke(ldt, [word.replace("{files}", str(files)) for word in shlex.split(line)])
    said = capsys.readouterr()
    assert code == (1 if line.startswith("identify") and "--machine" not in line else 2)
    assert step.replace("{files}", str(files)) in said.err
    assert said.err.count("\n") == 1
    assert said.out == ""
    assert list(tmp_path.iterdir()) == []
    assert sorted((p, p.stat().st_mtime_ns) for p in files.rglob("*")) == before


def test_force_replaces_and_the_former_spelling_goes_on(short_rotor, tmp_path, monkeypatch, capsys):
    """`--bag` is `--out`; what is there is refused without --force, which leaves nothing else."""
    monkeypatch.chdir(tmp_path)
    own = ["--machine", short_rotor, "--model", "physics"]
    assert invoke(ldt, ["run", *own, "--experiments", "2", "--bag", "mine"]) == 0
    assert invoke(ldt, ["run", *own, "--experiments", "1", "--bag=mine"]) == 2
    assert invoke(ldt, ["run", *own, "--experiments", "1", "-o", "mine", "--force"]) == 0
    assert [p.name for p in tmp_path.iterdir()] == ["mine"]
    capsys.readouterr()
    assert invoke(ldt, ["info", "mine", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["experiments"] == 1


def test_what_was_there_comes_back_where_nothing_new_was_made(tmp_path):
    """And stays beside what is incomplete."""
    place = tmp_path / "run"
    place.mkdir()
    (place / "metadata.yaml").write_text("before")

    def fail(new: str) -> None:
        with replacing(str(place), True):
            place.mkdir()
            if new:
                (place / "metadata.yaml").write_text(new)
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail("")
    assert [p.name for p in tmp_path.iterdir()] == ["run"]
    assert (place / "metadata.yaml").read_text() == "before"
    with pytest.raises(RuntimeError):
        fail("half")
    (aside,) = tmp_path.glob(".run.*.before")
    assert (aside / "metadata.yaml").read_text() == "before"


def test_a_recording_that_is_being_written_is_not_replaced(tmp_path, capsys):
    """Its run lost all that it had."""
    place = tmp_path / "run"
    for name in ("", "machine_1"):
        with BagWriter(place / name):
            assert invoke(ldt, ["run", "--experiments", "1", "-o", str(place), "--force"]) == 2
        told = capsys.readouterr().err
        assert f"--force: expected a recording that nobody is writing, got {place}" in told


def test_what_was_there_stays_beside_a_run_that_failed(tmp_path, capsys):
    """It was deleted, although nothing had been answered."""
    place = tmp_path / "run"
    own = tmp_path / "own.py"
    own.write_text(
        "from ldt_core.models.physics import PhysicsModel\n"
        "class Mine(PhysicsModel):\n    kind = 'mine'\n    predict = None\n"
    )
    with BagWriter(place):
        pass
    run_it = ["run", "--experiments", "1", "-o", str(place), "--force", "--model", f"{own}:Mine"]
    assert invoke(ldt, run_it) == 1
    assert "the earlier one is kept as" in capsys.readouterr().err
    assert len(list(tmp_path.glob(".run.*.before"))) == 1


def test_what_was_there_and_cannot_be_deleted_is_named(tmp_path, monkeypatch, capsys):
    """Another user's; the command failed, with the name of a file alone, and said no results."""
    place = tmp_path / "run"
    place.mkdir()
    (place / "metadata.yaml").write_text("before")

    def refuse(folder):
        raise PermissionError(13, "Permission denied", "metadata.yaml")

    monkeypatch.setattr(shutil, "rmtree", refuse)
    with replacing(str(place), True):
        place.mkdir()
    (aside,) = tmp_path.glob(".run.*.before")
    told = capsys.readouterr().err
    assert f"cannot be deleted and is kept as {aside}: Permission denied" in told


def test_a_diagnosis_that_names_nothing_is_said_to_add_nothing(tmp_path, capsys):
    """The prediction is that of the machine file alone."""
    none = tmp_path / "none.json"
    none.write_text('{"verdict": {"kind": "unknown"}, "effects": []}')
    beside = ["--with", str(none), "--out", str(tmp_path / "out")]
    assert invoke(ldt, ["predict", str(RUN), *beside]) == 0
    assert f"{none} names no effect, so nothing is added" in capsys.readouterr().err


def test_the_way_to_a_speed_of_a_motor_is_drawn(tmp_path):
    """Which has no eccentricity to stand in the title."""
    picture = tmp_path / "way.svg"
    asked = ["--machine", "dc_motor", "--reach", "100", "--out", str(picture)]
    assert invoke(ldt, ["advise", *asked]) == 0
    assert picture.stat().st_size > 10_000


def test_one_long_experiment_is_told_how_to_become_some(tmp_path, capsys):
    """As a twin learns between experiments; not where it was asked for."""
    table = tmp_path / "long.csv"
    table.write_text("t,u,n\n" + "".join(f"{t / 10},{t % 7},{t % 5}\n" for t in range(300)))
    fields = ["--voltage", "u:V", "--speed", "n:rad/s", "--time", "t:s"]
    assert invoke(ldt, ["import", str(table), *fields, "--out", str(tmp_path / "one")]) == 0
    assert "--length 10 cuts this one" in capsys.readouterr().out
    asked = ["--length", "29", "--out", str(tmp_path / "asked")]
    assert invoke(ldt, ["import", str(table), *fields, *asked]) == 0
    assert "cuts this one" not in capsys.readouterr().out


def test_a_recording_says_what_is_in_it(capsys):
    """Machine, number, length, channels, models, signals, and how it ended."""
    assert invoke(ldt, ["info", str(RUN)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "machine rotor" in said
    assert "20 s (2000 samples at 100 Hz)" in said
    assert "voltage [V], speed [rad/s]" in said
    assert "models hybrid 23" in said
    assert "negative 6, positive 29, warning 5" in said
    assert "complete: 40 of 40 experiments" in said


def test_a_foreign_recording_says_its_topics_and_how_to_import_them(files, capsys):
    """With the topics that may be the voltage and the speed in the command."""
    assert invoke(ldt, ["info", str(files / "foreign")]) == 0
    said = capsys.readouterr().out
    assert "/press/command  std_msgs/msg/Float64, 1 message" in said
    assert "--voltage /press/command.data --speed /TOPIC" in said


def test_a_table_says_its_columns_and_how_to_import_it(files, capsys):
    """A unit in a column's name says what it is; of a symbol the unit is left to the reader."""
    assert invoke(ldt, ["info", str(files / "log.csv")]) == 0
    said = capsys.readouterr().out
    assert "the columns 'time_ms', 'u', 'rpm'" in said
    assert "--voltage u:UNIT --speed rpm:rpm --time time_ms:ms" in said


def test_several_tables_are_told_at_once(files, tmp_path, capsys):
    """The columns of the first, which others have them too, and one command for these."""
    names = ("r1", "r2", "other")
    first, second, other = (str(tmp_path / f"{name}.csv") for name in names)
    for name in (first, second):
        shutil.copy(files / "plc.csv", name)
    shutil.copy(files / "log.csv", other)
    assert invoke(ldt, ["info", first, second, other]) == 0
    told = capsys.readouterr().out
    assert f"with the same columns: {second}\nwith other columns: {other}\n" in told
    assert f"ldt import {first} {second} --voltage Spannung" in told
    assert invoke(ldt, ["info", other, str(files / "motor"), "--json"]) == 0
    recording, table = json.loads(capsys.readouterr().out)
    assert (recording["experiments"], table["table"], table["alike"]) == (1, True, [])


@pytest.mark.parametrize("date", ["2026-03-02T08:00:{:06.3f}", "02.03.2026 08:00:{:06.3f}"])
def test_a_column_of_dates_is_the_time_and_needs_no_unit(tmp_path, capsys, date):
    """Whatever its name; so it is read."""
    table, out = tmp_path / "dated.csv", tmp_path / "out"
    rows = "".join(f"{date.format(t / 10)};{t % 7};{t % 5}\n" for t in range(300))
    table.write_text("Datum;Spannung [V];Drehzahl [U/min]\n" + rows)
    assert invoke(ldt, ["info", str(table)]) == 0
    *_, proposed = capsys.readouterr().out.splitlines()
    assert "--time Datum --length 10" in proposed
    command = shlex.split(proposed.replace("--out imported", f"--out {out}"))
    assert invoke(ldt, command[1:]) == 0
    assert "3 experiments of 100 samples at 10 Hz" in capsys.readouterr().out


def test_a_delimiter_at_the_end_of_each_row_is_no_column(tmp_path, capsys):
    """Nothing above the names is to be deleted, and what is proposed works."""
    table = tmp_path / "x.csv"
    table.write_text("t_s;u;n;\n" + "".join(f"{t};{t % 7};{t % 5};\n" for t in range(30)))
    assert invoke(ldt, ["info", str(table)]) == 0
    told = capsys.readouterr().out
    assert "the columns 't_s', 'u', 'n'\n" in told
    assert "delete" not in told
    assert invoke(ldt, ["import", str(table), "--voltage", "x", "--speed", "n", "-o", "x"]) == 2


@pytest.mark.parametrize(
    ("count", "pause", "cut"), [(60, 0, False), (300, 0, True), (300, 2, False)]
)
def test_a_length_is_proposed_where_it_gives_experiments(tmp_path, capsys, count, pause, cut):
    """Not of a record of 6 s, nor of stretches of 6 s between gaps; the import says the same."""
    table, out = tmp_path / "x.csv", str(tmp_path / "out")
    times = [t / 10 + pause * (t // 60) for t in range(count)]
    table.write_text("t_s,u,n\n" + "".join(f"{t},{k % 7},{k % 5}\n" for k, t in enumerate(times)))
    assert invoke(ldt, ["info", str(table)]) == 0
    assert ("--length 10" in capsys.readouterr().out) is cut
    fields = ["--voltage", "u:V", "--speed", "n:rad/s", "--time", "t_s"]
    assert invoke(ldt, ["import", str(table), *fields, "--out", out]) == 0
    told = capsys.readouterr().out
    assert ("--length 10" in told) is cut
    assert ("cut this one by --length" in told) is (not cut and not pause)


def test_a_word_within_a_column_s_name_is_found(tmp_path, capsys):
    """As in a German machine's log."""
    table = tmp_path / "anlage.csv"
    table.write_text("Zeitstempel_ms,Ankerspannung,Drehzahl_rpm\n0,1,2\n1,1,2\n")
    assert invoke(ldt, ["info", str(table)]) == 0
    said = capsys.readouterr().out
    assert "--voltage Ankerspannung:UNIT --speed Drehzahl_rpm:rpm --time Zeitstempel_ms:ms" in said


def test_columns_whose_names_say_nothing_are_told_by_what_they_hold(tmp_path, capsys):
    """The range of each; the only one that always rises is the time. Words do no harm."""
    table = tmp_path / "mixer.csv"
    rows = [f"{10 * t},{t % 7},{t % 5}" for t in range(50)]
    table.write_text("\n".join(["Stamp,Uk,Ndreh", *rows]))
    assert invoke(ldt, ["info", str(table)]) == 0
    told = capsys.readouterr().out
    assert "'Stamp' (0 to 490), 'Uk' (0 to 6), 'Ndreh' (0 to 4)" in told
    assert "--speed COLUMN:UNIT --time Stamp:UNIT --out" in told
    table.write_text("\n".join(["Stamp,Uk,Ndreh,Note", *(f"{row},ok" for row in rows)]))
    assert invoke(ldt, ["info", str(table)]) == 0
    assert "'Stamp' (10 from row to row: ms?), 'Uk', 'Ndreh', 'Note'\n" in capsys.readouterr().out


def test_a_table_of_a_plc_says_its_units_in_a_row_of_their_own(files, capsys):
    """Which then say what each column is; a table without a header is told of."""
    assert invoke(ldt, ["info", str(files / "plc.csv")]) == 0
    proposed = "--voltage Spannung --speed Drehzahl:U/min --time Zeit:ms"
    assert proposed in capsys.readouterr().out
    assert invoke(ldt, ["info", str(files / "bare.csv")]) == 0
    told = capsys.readouterr().out
    assert "the columns 1 (0 to 49), 2 (0 to 6), 3 (0 to 4) (by number, as no header line" in told
    assert "--voltage NUMBER:UNIT --speed NUMBER:UNIT --time 1" in told


def test_a_folder_of_recordings_lists_them(files, capsys):
    """As a fleet's is."""
    assert invoke(ldt, ["info", str(files)]) == 0
    assert f"ldt info {files}/motor" in capsys.readouterr().out


def test_the_last_of_two_values_counts(tmp_path, capsys):
    """A script's defaults can be overridden; of files that would drop one in silence."""
    twice = ["--experiments", "2", "--seed", "1", "--seed", "2", "--experiments", "1"]
    assert invoke(ldt, ["simulate", *twice, "--out", str(tmp_path / "out")]) == 0
    assert "1 experiment" in capsys.readouterr().out


def test_long_work_says_on_a_pipe_how_far_it_is(monkeypatch, capsys):
    """A line now and then on standard error; quick work says nothing.

    One item more than the first, which also compiles, does not tell how long the others take.
    """
    clock = iter(range(0, 1000, 16))
    monkeypatch.setattr(time, "monotonic", lambda: float(next(clock)))
    done = list(progress.track(range(6), "simulating"))
    told = capsys.readouterr()
    assert done == list(range(6))
    assert told.out == ""
    lines = "simulating: 2 of 6\nsimulating: 4 of 6, about 32 s left\nsimulating: 6 of 6\n"
    assert told.err == lines
    monkeypatch.undo()
    assert list(progress.track(range(6), "simulating")) == done
    assert capsys.readouterr().err == ""
