"""`--only`: some experiments of a recording, by their numbers."""

from __future__ import annotations

import json

import pytest
import yaml

from ldt_core.cli import invoke, ldt
from ldt_core.recording.bag import read_bag
from tests.motors import all_but


@pytest.fixture(scope="module")
def motor(tmp_path_factory):
    """Eight experiments of a motor."""
    folder = tmp_path_factory.mktemp("only")
    common = ["simulate", "--machine", "dc_motor", "--noise", "0.05"]
    assert invoke(ldt, [*common, "--experiments", "8", "--out", str(folder / "motor")]) == 0
    return str(folder / "motor")


def numbers(path):
    return [e.number for e in read_bag(path).experiments()]


@pytest.mark.parametrize(
    ("command", "options"),
    [
        ("predict", ()),
        ("replay", ("--model", "physics")),
        ("run", ("--model", "physics")),
    ],
)
def test_what_plays_a_recording_takes_the_chosen_experiments(command, options, motor, tmp_path):
    """Those of a run are recorded as such, so that it goes on with the same."""
    out = str(tmp_path / "out")
    played = ["--play", motor] if command == "run" else [motor]
    chosen = ["--machine", "dc_motor", "--only", "2-3, 7-", "--out", out]
    assert invoke(ldt, [command, *played, *options, *chosen]) == 0
    assert numbers(out) == [2, 3, 7, 8]
    if command == "run":
        assert read_bag(out).settings()["only"] == "2-3, 7-"
        assert invoke(ldt, ["run", "--resume", out, "--play", motor]) == 0
        assert numbers(out) == [2, 3, 7, 8]


def test_what_fits_a_recording_takes_the_chosen_experiments(motor, tmp_path, capsys):
    """Of several recordings, of each; the command that comes next has the same choice."""
    calibrated, why = tmp_path / "fitted.yaml", tmp_path / "why"
    chosen = ["--machine", "dc_motor", "--only", "2-7"]
    assert invoke(ldt, ["calibrate", motor, *chosen, "--out", str(calibrated)]) == 0
    fit = yaml.safe_load(calibrated.read_text())["calibration"]
    assert sorted(fit["experiments"] + fit["held_out"]["experiments"]) == [2, 3, 4, 5, 6, 7]
    assert invoke(ldt, ["identify", motor, "--only", "1-4", "--out", str(tmp_path / "i.yaml")]) == 0
    assert f"ldt diagnose {motor} --only 1-4 --machine" in capsys.readouterr().out
    few = [word for name in all_but("inertia") for word in ("--without", name)]
    assert invoke(ldt, ["diagnose", motor, *chosen, *few, "--out", str(why)]) == 0
    fit = json.loads((why / "diagnosis.json").read_text())["experiments"]
    assert sorted(fit["fit"] + fit["held_out"]) == [2, 3, 4, 5, 6, 7]
    assert " --only 2-7\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("only", "words"),
    [
        ("9-", "motor, --only: expected some of experiments 1 to 8, got none of them"),
        ("3-2", "--only: expected numbers of experiments, such as 1-20,25 or 21-, got '3-2'"),
        ("0", "--only: expected numbers of experiments"),
        ("1,,2", "--only: expected numbers of experiments"),
        ("-3", "--only: expected numbers of experiments"),
        ("1-2-3", "--only: expected numbers of experiments"),
        ("١", "--only: expected numbers of experiments"),
    ],
)
def test_what_chooses_no_experiment_is_refused(only, words, motor, tmp_path, capsys):
    """In a sentence."""
    out = ["--machine", "dc_motor", "--out", str(tmp_path / "out")]
    assert invoke(ldt, ["predict", motor, *out, "--only", only]) == 2
    assert words in capsys.readouterr().err


def test_it_serves_a_recording_alone(tmp_path, capsys):
    """A simulation has no experiments to choose from."""
    assert invoke(ldt, ["run", "--only", "3", "--out", str(tmp_path / "run")]) == 2
    assert "--only: expected --play as well" in capsys.readouterr().err
