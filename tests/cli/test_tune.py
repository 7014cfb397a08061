"""`ldt tune`: a recording and a budget in, a detector and its threshold out."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from ldt_core.cli import invoke, replay
from ldt_core.cli import simulate as simulation
from ldt_core.cli.tune import DETECTORS, command
from ldt_core.lab.tuning.candidates import TUNED

pytest.importorskip("matplotlib")

#: A model that is quick to learn, few settings, and this process alone.
QUICK = ["--model", "linear", "--order", "1", "--values", "2", "--jobs", "1"]


def call(*arguments):
    return invoke(command, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def bag(tmp_path_factory, short_rotor):
    """Two dozen short experiments of a rotor that wears."""
    out = tmp_path_factory.mktemp("bag") / "bag"
    words = f"--machine {short_rotor} --experiments 24 --seed 4 --degradation ramp --out {out}"
    assert invoke(simulation.command, words.split()) == 0
    return out


@pytest.fixture(scope="module")
def tuned(tmp_path_factory, bag, short_rotor):
    """(command line, folder) of one that is done, and only says so when it is called again."""
    out = tmp_path_factory.mktemp("tuned") / "out"
    words = [bag, "--machine", short_rotor, *QUICK, "--detector", "window", "--adaptations", "4"]
    assert call(*words, "--out", out) == 0
    return words, out


def test_the_commands_and_the_core_know_the_same_detectors():
    assert tuple(TUNED) == DETECTORS


def test_a_recording_is_tuned_end_to_end(bag, short_rotor, tmp_path, capsys):
    """The budget is kept; the options it prints and the file it writes give just that run."""
    out = tmp_path / "tuned"
    machine = ["--machine", short_rotor]
    how = ["--detector", "window", "--adaptations", "6", "--json"]
    assert call(bag, *machine, *QUICK, *how, "--out", out) == 0
    shown = capsys.readouterr()
    # Where it takes long it says how far it is, and nothing else.
    assert [line for line in shown.err.splitlines() if not line.startswith("tuning: ")] == []
    record = json.loads(shown.out)
    assert record["adaptations"] <= 6
    assert record["mme"] < record["mme_never"]
    assert {"tune.json", "tune.csv", "tradeoff.png", "tradeoff.svg"} <= {
        f.name for f in out.iterdir()
    }
    for index, options in enumerate(
        (["--settings", str(out / "tune.json")], [*QUICK[:4], *record["options"].split()])
    ):
        words = [str(bag), *machine, *options, "--out", str(tmp_path / f"again{index}"), "--json"]
        assert invoke(replay.command, words) == 0
        again = json.loads(capsys.readouterr().out)["runs"][0]
        assert again["adaptations"] == record["adaptations"]
        assert again["mme"] == pytest.approx(record["mme"], rel=1e-12)


def test_it_says_why(tuned, capsys):
    """Sentence first, then the reasons, then what to paste."""
    words, out = tuned
    assert call(*words, "--out", out) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("window with window ")
    assert "at most 4 adaptations" in lines[0]
    assert any(line.startswith("- without learning") for line in lines)
    assert any(line.startswith("options: --detector window --window ") for line in lines)


def test_a_budget_that_nothing_keeps_is_said_with_the_nearest(bag, short_rotor, tmp_path, capsys):
    """Exit code 1, one sentence, and all that was tried is there to look at."""
    words = ["--machine", short_rotor, *QUICK, "--detector", "lddm", "--in-control", "1:6"]
    out = tmp_path / "out"
    assert call(bag, *words, "--false-alarms-every", "1e6", "--out", out) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert "none of the" in said.err
    assert "--detector lddm --error-threshold" in said.err
    assert json.loads((out / "tune.json").read_text())["settings"] is None
    assert (out / "tradeoff.png").exists()


def test_another_recordings_result_is_not_replaced_without_a_word(
    tuned, bag, short_rotor, tmp_path
):
    """The same recording goes on in its folder, also by another budget."""
    out, other = tmp_path / "out", tmp_path / "other"
    shutil.copytree(tuned[1], out)
    words = ["--machine", short_rotor, *QUICK, "--detector", "window", "--out", out]
    assert call(bag, *words, "--adaptations", "5") == 0
    before = (out / "tune.json").read_bytes()
    made = f"--machine {short_rotor} --experiments 24 --seed 5 --degradation ramp --out {other}"
    assert invoke(simulation.command, made.split()) == 0
    assert call(other, *words, "--adaptations", "4") == 2
    assert (out / "tune.json").read_bytes() == before
    assert call(other, *words, "--adaptations", "4", "--force") == 0
    assert (out / "tune.json").read_bytes() != before


@pytest.mark.parametrize("place", ["new", "runs"])
def test_a_folder_that_cannot_be_written_to_is_refused_at_once(
    place, bag, short_rotor, tmp_path, monkeypatch, one_sentence
):
    """Not when the first result is there, of which a tuning makes one in minutes."""
    monkeypatch.setattr("ldt_core.lab.tuning.tune.try_setting", pytest.fail)
    out = Path("/proc/tuned")
    if place == "runs":  # of an earlier tuning, by another user
        out = tmp_path / "out"
        out.mkdir()
        (out / "runs").symlink_to("/proc")
    words = ["--machine", short_rotor, *QUICK, "--detector", "window", "--out", out]
    assert call(bag, *words, "--adaptations", "4") == 2
    assert one_sentence().startswith("ldt: --out: expected a folder that can be written to, got ")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "--adaptations 10"),
        (["--adaptations", "0"], "--adaptations"),
        (["--false-alarms-every", "100", "--in-control", "1:99"], "1 to 24"),
        (["--false-alarms-every", "100", "--in-control", "1:3"], "at least 5"),
        (["--adaptations", "5", "--in-control", "one"], "1:20,60:80"),
        (["--adaptations", "5", "--detector", "ldm"], "lddm"),
        (["--adaptations", "5", "--namespace", "nobody"], "nobody"),
        (["--adaptations", "5", "--model", "lineer"], "did you mean 'linear'"),
    ],
)
def test_what_is_wrong_gets_one_sentence(
    bag, short_rotor, tmp_path, one_sentence, arguments, sentence
):
    out = tmp_path / "out"
    assert call(bag, "--machine", short_rotor, *arguments, "--out", out) == 2
    assert sentence in one_sentence()
    assert not out.exists()


def test_a_recording_too_short_is_named(short_rotor, tmp_path, capsys):
    short = tmp_path / "short"
    words = f"--machine {short_rotor} --experiments 5 --out {short}"
    assert invoke(simulation.command, words.split()) == 0
    capsys.readouterr()
    arguments = ["--machine", short_rotor, "--adaptations", "3", "--out", tmp_path / "out"]
    assert call(short, *arguments) == 2
    said = capsys.readouterr().err
    assert str(short) in said
    assert "at least 10 experiments" in said


# ---- parameters from a file


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{", "neither YAML nor JSON"),
        ("[1, 2]", "parameters with values"),
        ("{thresold: 2}", "did you mean 'threshold'"),
        ("{settings: {threshold: high}}", "threshold"),
        ("settings: null", "parameters with values"),
    ],
)
def test_a_bad_file_of_parameters_gets_one_sentence(bag, tmp_path, one_sentence, text, sentence):
    file = tmp_path / "bad.json"
    file.write_text(text)
    arguments = [str(bag), "--settings", str(file), "--out", str(tmp_path / "out")]
    assert invoke(replay.command, arguments) == 2
    assert sentence in one_sentence()


def test_options_go_before_a_file_of_parameters(bag, short_rotor, tmp_path, capsys):
    file = tmp_path / "mine.yaml"
    file.write_text(
        f"machine: {short_rotor}\nmodel: physics\ndetector: window\nwindow: 3\nseed: 5\n"
    )
    arguments = [str(bag), "--settings", str(file), "--window", "4", "--json", "--out"]
    assert invoke(replay.command, [*arguments, str(tmp_path / "out")]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["settings"]["window"] == 4
    assert record["settings"]["model"] == "physics"
    assert record["runs"][0]["positives"] == 6
