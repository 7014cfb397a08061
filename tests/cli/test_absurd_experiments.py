"""One experiment that no machine can have made: each command leaves it out, and says which."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import ldt_core as ldt_api
from ldt_core.base.errors import ExperimentError
from ldt_core.cli import invoke, ldt
from ldt_core.machine.experiment_limits import outsized
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import BagWriter
from tests.motors import all_but

COUNT, BAD = 8, 3
FEW = [word for name in all_but("inertia") for word in ("--without", name)]
COMMANDS = {
    "calibrate": ["--machine", "dc_motor", "--out", "made.yaml", "--json"],
    "identify": ["--out", "made.yaml", "--json"],
    "diagnose": ["--machine", "dc_motor", *FEW, "--out", "made", "--json"],
    "predict": ["--machine", "dc_motor", "--out", "made", "--json"],
    "advise": ["--machine", "dc_motor", "--json"],
}


def recorded(folder, size, machine="dc_motor", which=(BAD,)):
    """Experiments of a motor, some with speeds of this size in turn."""
    made = ldt_api.simulate("dc_motor", COUNT, seed=3, noise=0.1)
    with BagWriter(folder, machine=machine) as writer:
        for e in made:
            one = e.part(0, 300)
            if one.number in which:
                one = replace(one, speed=np.where(np.arange(300) % 2, size, -size))
            writer.write("experiment", one, one.end)
    return folder


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("size", [1e308, 1e9])
def test_one_absurd_experiment_is_left_out_and_told(command, size, tmp_path, monkeypatch, capsys):
    """By its number; the others are used, as they are without it."""
    monkeypatch.chdir(tmp_path)
    bag = recorded(tmp_path / "bag", size)
    assert invoke(ldt, [command, "bag", *COMMANDS[command]]) == 0
    printed = capsys.readouterr()
    assert "left out" in printed.err
    assert f"{BAD}" in printed.err
    json.loads(printed.out)
    if command == "predict":
        numbers = [e.number for e in read_bag("made").records("prediction")]
        assert numbers == [n for n in range(1, COUNT + 1) if n != BAD]
    assert len(list(read_bag(bag).experiments())) == COUNT


def test_nothing_but_absurd_experiments_is_refused(tmp_path, monkeypatch, capsys):
    """With the file, and the first of them."""
    monkeypatch.chdir(tmp_path)
    recorded(tmp_path / "bag", 1e9, which=range(1, COUNT + 1))
    for command in ("calibrate", "diagnose", "predict"):
        assert invoke(ldt, [command, "bag", *COMMANDS[command]]) == 2
        assert "bag, experiment 1, speed: expected at most" in capsys.readouterr().err
        assert not (tmp_path / "made").exists()


@pytest.mark.parametrize("effects", [[], ["--effects", "coulomb_friction"]])
def test_sizes_beyond_floating_point_are_refused_without_a_warning(
    effects, tmp_path, monkeypatch, capsys
):
    """Where all experiments have them, so that none is held to the others."""
    monkeypatch.chdir(tmp_path)
    recorded(tmp_path / "bag", 1e308, which=range(1, COUNT + 1))
    assert invoke(ldt, ["identify", "bag", "--out", "made.yaml", *effects]) == 2
    assert capsys.readouterr().err.startswith("ldt: bag, ")


@pytest.mark.parametrize("machine", ["dc_motor", "my press"])
def test_the_doctor_names_it(machine, tmp_path, capsys):
    """Held to the machine where its file ships, else to the other experiments."""
    bag = recorded(tmp_path / "bag", 1e308, machine)
    assert invoke(ldt, ["doctor", str(bag)]) == 0
    told = [
        line for line in capsys.readouterr().out.splitlines() if "cannot have been made" in line
    ]
    assert len(told) == 1
    assert f"number {BAD} cannot have been made" in told[0]


def test_python_says_how_to_leave_it_out(tmp_path):
    """A list is the caller's own."""
    recording = ldt_api.read(recorded(tmp_path / "bag", 1e308))
    with pytest.raises(ExperimentError, match=r"machine.may_have_made\(e\)\] leaves it out"):
        ldt_api.calibrate(recording, "dc_motor")
    machine = load_machine("dc_motor")
    assert ldt_api.calibrate([e for e in recording if machine.may_have_made(e)], machine)


@pytest.mark.parametrize(
    ("sizes", "places"),
    [([1.0, 2.0, 3e4], [2]), ([1.0, 1e5], [1]), ([0.0, 0.0, 5.0], []), ([0.0], []), ([7.0], [])],
)
def test_what_is_held_to_the_others(sizes, places):
    """To the lower middle one of those that move at all."""
    assert outsized(sizes) == places


def test_an_effect_that_is_given_twice_is_refused(capsys):
    """Both would add up unseen."""
    twice = ["--effect", "coulomb_friction:torque=.1", "--effect", "coulomb_friction:torque=.2"]
    assert invoke(ldt, ["run", "--machine", "dc_motor", "--no-bag", *twice]) == 2
    assert "effect coulomb_friction: expected once" in capsys.readouterr().err
    assert invoke(ldt, ["advise", "--machine", "rotor", *twice]) == 2
    assert "effect coulomb_friction: expected once" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["a b/../c", "a//b", "1a", "a-b", "x" * 300, "a\nb"])
def test_a_namespace_that_ros_could_not_have_is_refused(name, tmp_path, capsys):
    """By whatever would record under it; nothing is left behind."""
    out = tmp_path / "bag"
    for command in ("run", "simulate"):
        given = ["--machine", "dc_motor", "--experiments", "1", "--out", str(out)]
        assert invoke(ldt, [command, *given, "--namespace", name]) == 2
        assert capsys.readouterr().err.startswith("ldt: namespace: expected ")
        assert not out.exists()
