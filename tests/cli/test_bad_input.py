"""The table of bad input: what a user may get wrong, and the one sentence that comes back.

Each row is a command line; `{files}` is a folder of files that the module prepares, some of them
bad. Every command has to end with the row's exit code and exactly one sentence on standard error,
which holds the row's words, and must leave all files as they were.
"""

from __future__ import annotations

import gzip
import hashlib
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

import msgs_config
from ldt_core.base.experiment import Experiment
from ldt_core.cli import invoke, ldt
from ldt_core.recording.codec import encode
from ldt_core.recording.writer import BagWriter

BAD = 2  # exit code: what was given cannot be used


# ---- the files


def experiment(number: int, voltage: float = 10.0) -> Experiment:
    rest = np.zeros(60)
    return Experiment(number, 1e9 + 100 * number, 0.01, rest + voltage, rest)


def recording(folder: Path, *messages: object, namespace: str = "") -> Path:
    with BagWriter(folder, namespace=namespace, machine="rotor") as writer:
        for index, message in enumerate(messages):
            writer.write("experiment", message, 1e9 + index)
    return folder


def spoiled(at: int, value: float) -> object:
    """The message of an experiment with one number replaced; 0 to 2 are its head."""
    message = encode(experiment(1))
    message.data[at] = value
    return message


def foreign(folder: Path, topic: str) -> None:
    """A recording with a text on a topic."""
    from ldt_core.recording.messages import serialize, standard

    with BagWriter(folder) as writer:
        data = serialize(standard().String(data="hello"))
        writer.write_raw(topic, "std_msgs/msg/String", data, 1)


def machine(file: Path, change=lambda data: None) -> None:
    data = yaml.safe_load(msgs_config.machine_text("rotor"))
    change(data)
    file.write_text(yaml.safe_dump(data))


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Good and bad recordings, machine files, tables, and Python files."""
    folder = tmp_path_factory.mktemp("files")
    good = recording(folder / "good", *map(experiment, (1, 2, 3)))
    recording(folder / "limits", experiment(1, voltage=99.0))
    recording(folder / "nan", spoiled(10, np.nan))
    recording(folder / "zero_period", spoiled(2, 0.0))
    recording(folder / "half_number", spoiled(0, 1.5))
    recording(folder / "nothing_in_it")
    message = encode(experiment(1))
    message.layout.dim[0].stride = 7
    recording(folder / "stride", message)
    with BagWriter(folder / "two") as writer:
        for name in ("press", "mill"):
            writer.write(f"/{name}/experiment", experiment(1), 1e9)
    foreign(folder / "chatter", "/chatter")
    foreign(folder / "wrong_type", "/experiment")
    (folder / "empty_folder").mkdir()
    (folder / "rubbish.mcap").write_bytes(bytes(range(256)) * 40)
    (folder / "empty.mcap").write_bytes(b"")
    (folder / "cut.mcap").write_bytes((good / "good_0.mcap").read_bytes()[:20])
    shutil.copytree(good, folder / "lost_file")
    (folder / "lost_file" / "good_0.mcap").unlink()

    change = {
        "unknown_key": lambda d: d.update(paramters={}),
        "other_channels": lambda d: d.update(inputs={"flow": {"unit": "l/s"}}),
        "unknown_parameter": lambda d: d["parameters"].update(mass=4.9),
        "missing_key": lambda d: d.pop("limits"),
        "missing_parameter": lambda d: d["parameters"].pop("K_t"),
        "negative_mass": lambda d: d["parameters"].update(m=-4.9),
        "text_mass": lambda d: d["parameters"].update(m="4.9 kg"),
        "nan_mass": lambda d: d["parameters"].update(m=float("nan")),
        "true_mass": lambda d: d["parameters"].update(m=True),
        "reversed_limits": lambda d: d["limits"].update(voltage=[24, -24]),
        "one_limit": lambda d: d["limits"].update(voltage=24),
        "no_duration": lambda d: d["experiment"].update(duration=0),
        "short_duration": lambda d: d["experiment"].update(duration=0.01),
        "unknown_physics": lambda d: d.update(physics="dc_moter"),
        "unknown_excitation": lambda d: d["simulation"]["voltage"].update(kind="stairs"),
        "high_excitation": lambda d: d["simulation"]["voltage"].update(high=99),
        "unknown_wear": lambda d: d["simulation"]["degradation"].update(effect="rust"),
        "list_of_parameters": lambda d: d.update(parameters=[1, 2]),
        "number_as_name": lambda d: d.update(name=5),
    }
    for name, edit in change.items():
        machine(folder / f"{name}.yaml", edit)
    (folder / "no_yaml.yaml").write_text("name: [rotor\nphysics: {")
    (folder / "empty.yaml").write_text("")
    (folder / "binary.yaml").write_bytes(b"\xff\xfe\x00name")
    (folder / "deep.yaml").write_text("[" * 500)
    (folder / "evil.yaml").write_text("name: !!python/object/apply:os.system [touch evil]\n")
    (folder / "large.yaml").write_text("#" * 2_000_000)

    rows = "".join(f"{t / 100},{t % 7},{t % 5}\n" for t in range(300))
    (folder / "good.csv").write_text("t,u,n\n" + rows)
    (folder / "word.csv").write_text("t,u,n\n" + rows + "3.0,high,4\n")
    (folder / "nan.csv").write_text("t,u,n\n" + rows + "3.0,nan,4\n")
    (folder / "ragged.csv").write_text("t,u,n\n" + rows + "3.0,1\n")
    (folder / "empty.csv").write_text("")
    (folder / "binary.csv").write_bytes(bytes(range(256)) * 10)
    (folder / "backwards.csv").write_text("t,u,n\n" + rows + "0.5,1,1\n")
    (folder / "cut.csv.gz").write_bytes(gzip.compress(rows.encode())[:100])

    (folder / "syntax.py").write_text("def broken(:\n")
    (folder / "raises.py").write_text("raise RuntimeError('not today')\n")
    (folder / "model.py").write_text("class NoModel:\n    pass\n\nNUMBER = 5\n")
    (folder / "mine").mkdir()
    (folder / "mine" / "precious.txt").write_text("mine")
    (folder / "a_file").write_text("mine as well")
    return folder


# ---- the table: command line, exit code, words of the sentence

GOOD = "{files}/good"
CSV = "--voltage u --speed n --time t --out out"

ROWS: list[tuple[str, int, list[str]]] = [
    # the command line itself
    ("rnu", BAD, ["'rnu'", "did you mean 'run'"]),
    ("fly", BAD, ["'fly'", "commands are", "replay"]),
    ("run --treshold 2", BAD, ["--treshold", "did you mean '--threshold'?"]),
    ("run --experiments ten", BAD, ["--experiments", "'ten'", "a whole number"]),
    ("run --experiments", BAD, ["--experiments", "argument"]),
    ("run --experiments 0", BAD, ["--experiments", "1 to", "got 0"]),
    ("run --experiments 2.5", BAD, ["--experiments", "'2.5'"]),
    ("run --seed -1", BAD, ["--seed", "0 to 4.29497e+09", "got -1"]),
    ("run --threshold nan", BAD, ["--threshold", "a finite number", "nan"]),
    ("run --threshold -1", BAD, ["--threshold", "0 to 1e+09 rad/s", "got -1"]),
    ("run --holdout 0.9", BAD, ["--holdout", "0.05 to 0.5", "got 0.9"]),
    ("run --start-time 5e10", BAD, ["--start-time", "-1 to 9.2e+09 s", "got 50000000000.0"]),
    ("run --gate maybe", BAD, ["--gate", "'holdout', 'none'", "'maybe'"]),
    ("run --rate fast", BAD, ["rate", "max or a number above 0", "'fast'"]),
    ("run --rate 0", BAD, ["rate", "max or a number above 0", "'0'"]),
    ("run surplus", BAD, ["surplus"]),
    ("replay", BAD, ["RECORDING"]),
    (f"replay {GOOD}", BAD, ["--out"]),
    # names
    ("run --model lineer", BAD, ["model", "did you mean 'linear'?", "'lineer'"]),
    ("run --detector lddmm", BAD, ["detector", "did you mean 'lddm'?", "'lddmm'"]),
    ("run --machine roter", BAD, ["machine", "did you mean 'rotor'?", "'roter'"]),
    ("simulate --effect unbalanced --out out", BAD, ["effect", "did you mean 'unbalance'?"]),
    ("simulate --effect unbalance:x=1 --out out", BAD, ["unbalance", "'e'", "'x'"]),
    ("simulate --effect unbalance:e --out out", BAD, ["unbalance", "param=value", "'e'"]),
    ("simulate --effect unbalance:e=big --out out", BAD, ["unbalance", "a number", "'big'"]),
    ("simulate --effect inertia:factor=-1 --out out", BAD, ["inertia"]),
    ("simulate --effect unbalance:e=nan --out out", BAD, ["unbalance, e", "nan"]),
    ("run --model {files}/none.py:Model", BAD, ["model", "{files}/none.py", "no such file"]),
    ("run --model {files}/model.py:Modell", BAD, ["{files}/model.py", "'Modell'"]),
    ("run --model {files}/model.py:NoModel", BAD, ["model", "NoModel"]),
    ("run --model {files}/model.py:NUMBER", BAD, ["model", "NUMBER"]),
    ("run --model {files}/syntax.py:Model", BAD, ["{files}/syntax.py", "line 1"]),
    ("run --detector {files}/raises.py:D", BAD, ["{files}/raises.py", "not today"]),
    ("run --detector {files}/model.py:NoModel", BAD, ["detector", "NoModel"]),
    ("run --detector river --detector-argument x", BAD, ["x"]),
    # recordings to read
    *[
        (f"{command} {{files}}/{name} {rest} --out out", BAD, [f"{{files}}/{name}", *words])
        for command, rest in (
            ("replay", "--model physics"),
            ("predict", "--machine rotor"),
            ("calibrate", "--machine rotor"),
            ("identify", ""),
        )
        for name, words in (
            ("nowhere", ["expected"]),
            ("empty_folder", ["expected"]),
            ("nothing_in_it", ["expected"]),
            ("rubbish.mcap", ["expected"]),
            ("empty.mcap", ["expected"]),
            ("cut.mcap", ["expected"]),
            ("lost_file", ["expected"]),
            ("good.csv", ["expected"]),
            ("chatter", ["a topic named experiment", "/chatter"]),
            ("wrong_type", ["a topic named experiment", "/experiment (std_msgs/msg/String)"]),
            ("nan", ["/experiment, message 1", "finite", "nan"]),
            ("zero_period", ["/experiment, message 1", "sample period", "above 0", "0.0"]),
            ("half_number", ["/experiment, message 1", "experiment number", "1.5"]),
            ("stride", ["/experiment, message 1", "layout.dim[0].stride", "7"]),
            ("two", ["one machine", "--namespace", "/mill and /press"]),
        )
    ],
    (f"replay {GOOD} --namespace press --out out", BAD, [GOOD, "/press"]),
    ("predict {files}/limits --out out", BAD, ["voltage", "-24 to 24 V", "99 V"]),
    ("run --play {files}/nowhere --bag out", BAD, ["{files}/nowhere"]),
    ("run --play {files}/nan --model physics --bag out", BAD, ["{files}/nan", "finite"]),
    # recordings to write
    (f"replay {GOOD} --model physics --out {{files}}/mine", BAD, ["mine", "does not exist"]),
    (f"replay {GOOD} --model physics --out {{files}}/a_file", BAD, ["a_file", "does not exist"]),
    (f"predict {GOOD} --out {GOOD}", BAD, [GOOD, "does not exist"]),
    ("simulate --experiments 2 --out {files}/mine", BAD, ["mine", "does not exist"]),
    ("run --experiments 2 --model physics --bag {files}/mine", BAD, ["mine", "does not exist"]),
    (f"import {{files}}/good.csv {CSV[:-4]} {{files}}/mine", BAD, ["mine", "does not exist"]),
    ("simulate --experiments 2 --out {files}/a_file/out", BAD, ["a_file/out", "place to write"]),
    ("simulate --experiments 2 --out /sys/ldt_out", BAD, ["/sys/ldt_out", "place to write"]),
    # machine files
    *[
        (f"{command} --machine {{files}}/{name}.yaml --out out", BAD, [f"{name}.yaml", *words])
        for command in (f"predict {GOOD}", f"replay {GOOD} --model physics")
        for name, words in (
            ("nowhere", ["a readable machine file", "no such file or folder\n"]),
            ("unknown_key", ["did you mean 'parameters'?", "unknown key 'paramters'"]),
            ("other_channels", ["inputs", "voltage in, speed and current out", "'flow'"]),
            ("unknown_parameter", ["parameters", "unknown key 'mass'"]),
            ("missing_key", ["the key 'limits'"]),
            ("missing_parameter", ["parameters", "the key 'K_t'"]),
            ("negative_mass", ["parameters.m", "-4.9"]),
            ("text_mass", ["parameters.m", "a number in SI units", "'4.9 kg'"]),
            ("nan_mass", ["parameters.m", "a finite number", "nan"]),
            ("true_mass", ["parameters.m", "a number in SI units", "True"]),
            ("reversed_limits", ["limits.voltage", "[lowest, highest] in V", "[24, -24]"]),
            ("one_limit", ["limits.voltage", "[lowest, highest] in V", "24"]),
            ("no_duration", ["experiment.duration", "seconds above 0"]),
            ("short_duration", ["experiment.duration", "two sample periods"]),
            ("unknown_physics", ["physics", "did you mean 'dc_motor'?", "'dc_moter'"]),
            ("list_of_parameters", ["parameters", "names with values"]),
            ("number_as_name", ["name", "a name", "5"]),
            ("no_yaml", ["YAML", "line"]),
            ("empty", ["names with values", "None"]),
            ("binary", ["a readable machine file", "UTF-8"]),
            ("deep", ["YAML"]),
            ("evil", ["YAML", "python/object/apply"]),
            ("large", ["at most 1000000 bytes"]),
        )
    ],
    ("predict {files}/good --machine {files} --out out", BAD, ["{files}", "a readable machine"]),
    *[
        (f"simulate --machine {{files}}/{name}.yaml --degradation staircase --out out", BAD, words)
        for name, words in (
            ("unknown_excitation", ["simulation.voltage.kind", "'stairs'"]),
            ("high_excitation", ["simulation.voltage", "99"]),
            ("unknown_wear", ["simulation.degradation", "'rust'"]),
        )
    ],
    # tables
    ("import {files}/nowhere.csv " + CSV, BAD, ["nowhere.csv"]),
    ("import {files}/empty.csv " + CSV, BAD, ["empty.csv"]),
    ("import {files}/binary.csv " + CSV, BAD, ["binary.csv"]),
    ("import {files}/cut.csv.gz " + CSV, BAD, ["cut.csv.gz"]),
    ("import {files}/word.csv " + CSV, BAD, ["word.csv", "line 302", "'high'"]),
    ("import {files}/nan.csv " + CSV, BAD, ["nan.csv", "line 302", "nan"]),
    ("import {files}/ragged.csv " + CSV, BAD, ["ragged.csv", "line 302"]),
    ("import {files}/backwards.csv " + CSV, BAD, ["backwards.csv", "line 302"]),
    ("import {files}/good.csv --voltage U --speed n --time t --out out", BAD, ["'U'", "'u'"]),
    (
        "import {files}/good.csv --voltage u --speed n:rmp --time t --out out",
        BAD,
        ["--speed", "'rpm'", "'rmp'"],
    ),
    ("import {files}/good.csv --voltage u --speed n --out out", BAD, ["--time", "--sample-period"]),
    ("import {files}/good.csv " + CSV + " --length 0", BAD, ["--length", "seconds above 0", "0"]),
    ("import {files}/good.csv " + CSV + " --length 0.01", BAD, ["--length", "0.01"]),
    ("import {files}/good " + CSV, BAD, ["{files}/good", "needs no import", "ldt info"]),
    # calibration
    (f"calibrate {GOOD} --machine rotor --free mass --out out.yaml", BAD, ["mass"]),
    (f"calibrate {GOOD} --machine rotor --holdout 2 --out out.yaml", BAD, ["--holdout", "2"]),
    (f"calibrate {GOOD} --machine rotor --out {{files}}/a_file", BAD, ["a_file"]),
    # a machine of unknown physics
    (f"identify {GOOD} --out {{files}}/a_file", BAD, ["a_file"]),
    (f"identify {GOOD} --holdout 2 --out out.yaml", BAD, ["--holdout", "2"]),
    (f"identify {GOOD} --limits low,high --out out.yaml", BAD, ["--limits", "'low,high'"]),
    (f"identify {GOOD} --out out.yaml", 1, ["cannot determine a linear model", "10 V throughout"]),
    # effects
    ("effects unbalanced", BAD, ["effect", "did you mean 'unbalance'?"]),
    ("effects {files}/none.py:MINE", BAD, ["{files}/none.py", "no such file"]),
    ("effects {files}/syntax.py:MINE", BAD, ["{files}/syntax.py", "line 1"]),
    ("effects {files}/model.py:NUMBER", BAD, ["NUMBER", "an object of class Effect", "5"]),
    # pictures
    (f"plot {GOOD} --out a.png", BAD, ["a run of a twin", "ldt replay", "no topic prediction"]),
    (f"report {GOOD} --out a.html", BAD, ["a run of a twin", "ldt replay", "no topic prediction"]),
    # the graph
    ("up --machines 2 --play {files}/good", BAD, ["machines", "1 together with play", "got 2"]),
    ("up --machines 0", BAD, ["--machines", "1 to 100", "got 0"]),
    ("up --bag {files}/mine", BAD, ["mine", "does not exist"]),
    ("up --machine {files}/negative_mass.yaml", BAD, ["parameters.m", "-4.9"]),
    ("up --model lineer", BAD, ["model", "did you mean 'linear'?"]),
    ("up --detector lddmm", BAD, ["detector", "did you mean 'lddm'?"]),
    ("up --rate fast", BAD, ["rate", "'fast'"]),
    ("up --play {files}/nowhere", BAD, ["{files}/nowhere"]),
    ("up --namespace 'no good'", BAD, ["namespace", "no good"]),
]


def digest(folder: Path) -> dict[str, str]:
    return {
        str(f.relative_to(folder)): hashlib.sha256(f.read_bytes()).hexdigest()
        for f in sorted(folder.rglob("*"))
        if f.is_file() and "__pycache__" not in f.parts
    }


@pytest.mark.parametrize(("line", "code", "words"), ROWS, ids=[row[0] for row in ROWS])
def test_bad_input_is_answered_by_one_sentence(
    line, code, words, files, tmp_path, monkeypatch, capfd
):
    """Exit code, one sentence that names what is at fault, no traceback, nothing overwritten."""
    if line.startswith("up"):
        pytest.importorskip("rclpy")
    monkeypatch.chdir(tmp_path)
    before = digest(files)
    arguments = [part.replace("{files}", str(files)) for part in shlex.split(line)]
    got = invoke(ldt, arguments)
    output, errors = capfd.readouterr()
    assert got == code, errors
    assert errors.startswith("ldt: "), errors
    assert errors.count("\n") == 1, errors
    assert errors.endswith("\n"), errors
    for word in words:
        assert word.replace("{files}", str(files)) in errors, errors
    assert output == ""
    assert digest(files) == before
    assert not (tmp_path / "evil").exists()
