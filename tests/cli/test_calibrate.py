"""`ldt calibrate`: recordings in, a machine file out, one sentence when something is wrong."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

from ldt_core.base.experiment import Experiment
from ldt_core.cli import import_file, invoke, predict
from ldt_core.cli.calibrate import command
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.writer import BagWriter

MOTOR = load_machine("dc_motor")


def record(path, count=4, numbers_from=1, level=(4, 12)):
    """A recording of a motor with other J and K_t than the machine file's."""
    true = MOTOR.with_parameters(J=0.0015, K_t=0.06)
    rng = np.random.default_rng(numbers_from)
    with BagWriter(str(path), machine="dc_motor") as writer:
        for number in range(numbers_from, numbers_from + count):
            volts = np.repeat(rng.uniform(*level, 6), 50)
            start = true.model.initial_state(true.parameters, 0.0)
            speed = true.model.simulate(true.parameters, volts, 0.01, start)[:, 1]
            noisy = speed + 0.1 * rng.standard_normal(300)
            e = Experiment(number, 3.0 * number, 0.01, volts, noisy)
            writer.write("experiment", e, e.end)
    return str(path)


@pytest.fixture
def bag(tmp_path):
    return record(tmp_path / "bag")


def call(*arguments):
    return invoke(command, [str(a) for a in arguments])


def test_the_file_it_writes_is_a_machine(bag, tmp_path, capsys):
    """The calibrated file loads, predicts ten times better, and keeps name and limits."""
    out = tmp_path / "motor.yaml"
    assert call(bag, "--machine", "dc_motor", "--free", "J, K_t", "--out", out) == 0
    shown = capsys.readouterr()
    assert "K_t" in shown.out
    assert "held out" in shown.out
    assert shown.err == ""
    machine = load_machine(out)
    assert machine.name == MOTOR.name
    assert machine.voltage_limits == MOTOR.voltage_limits
    assert machine.parameters["K_t"] == pytest.approx(0.06, rel=1e-3)
    assert machine.parameters["R"] == MOTOR.parameters["R"]
    assert machine.calibration["recordings"] == [bag]

    def error(name, target):
        assert (
            invoke(predict.command, [bag, "--machine", str(name), "--out", str(target), "--json"])
            == 0
        )
        return json.loads(capsys.readouterr().out)["rmse"]

    before, after = error("dc_motor", tmp_path / "p1"), error(out, tmp_path / "p2")
    assert after < before / 10


def test_a_diagnosed_friction_is_calibrated_with_its_presliding(bag, tmp_path, capsys):
    """It failed after its work, by an unknown key; long names left no room for intervals."""
    given = {"torque_forward": 0.01, "torque_backward": 0.02, "presliding": 0.01}
    found = {
        "verdict": {"effects": ["asymmetric_friction"]},
        "effects": [{"effect": "asymmetric_friction", "parameters": given}],
    }
    (tmp_path / "diagnosis.json").write_text(json.dumps(found))
    out, figures = tmp_path / "motor.yaml", ("--with", tmp_path / "diagnosis.json")
    assert call(bag, "--machine", "dc_motor", *figures, "--out", out) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any("asymmetric_friction." in line for line in lines)
    assert any("95 % interval" in line for line in lines)
    assert "asymmetric_friction.presliding" in load_machine(out).parameters


def test_json_is_all_that_it_prints(bag, tmp_path, capsys):
    """With --json, standard output is one object with the keys of the file's `calibration`."""
    out = tmp_path / "motor.yaml"
    assert call(bag, "--machine", "dc_motor", "--out", out, "--json", "--holdout", "0.5") == 0
    shown = json.loads(capsys.readouterr().out)
    assert {"free", "fixed", "undetermined", "rmse_before", "rmse_after", "noise"} <= set(shown)
    assert len(shown["held_out"]["experiments"]) == 2
    written = load_machine(out).calibration
    assert {k: v for k, v in shown.items() if k not in ("machine", "out")} == written


def test_several_recordings_count_as_one(bag, tmp_path, capsys):
    """Experiments of two recordings are fitted together and numbered on."""
    other = record(tmp_path / "other", numbers_from=3)
    out = tmp_path / "motor.yaml"
    assert call(bag, other, "--machine", "dc_motor", "--holdout", "0", "--out", out) == 0
    written = load_machine(out).calibration
    assert written["recordings"] == [bag, other]
    assert written["experiments"] == list(range(1, 9))


def test_a_file_is_not_overwritten_unasked(bag, tmp_path, capsys):
    out = tmp_path / "motor.yaml"
    out.write_text("precious")
    assert call(bag, "--machine", "dc_motor", "--out", out) == 2
    assert out.read_text() == "precious"
    assert "--force" in capsys.readouterr().err
    assert call(bag, "--machine", "dc_motor", "--out", out, "--force") == 0
    assert load_machine(out).calibration


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["--free", "Kt"], 2, "did you mean 'K_t'"),
        (["--free", "J", "--fixed", "R"], 2, "--free"),
        (["--fixed", "J,K_t,R,L,b"], 2, "leaves a parameter free"),
        (["--holdout", "1.5"], 2, "--holdout"),
        (["--namespace", "nobody"], 2, "nobody"),
        (["--machine", "nothing.yaml"], 2, "nothing.yaml"),
        (["--figure", "picture.bmp"], 2, ".png"),
    ],
)
def test_what_is_wrong_gets_one_sentence(bag, tmp_path, one_sentence, arguments, code, sentence):
    out = tmp_path / "motor.yaml"
    assert call(bag, "--machine", "dc_motor", *arguments, "--out", out) == code
    assert sentence in one_sentence()
    assert not out.exists()


def test_voltage_beyond_the_limits_names_the_recording(tmp_path, capsys):
    bad = record(tmp_path / "bad", level=(25, 30))
    assert call(bad, "--machine", "dc_motor", "--out", tmp_path / "m.yaml") == 2
    said = capsys.readouterr().err
    assert bad in said
    assert "experiment 1, voltage" in said


def test_a_missing_folder_is_said_before_any_work(bag, tmp_path, capsys):
    assert call(bag, "--machine", "dc_motor", "--out", tmp_path / "no" / "m.yaml") == 2
    assert "folder" in capsys.readouterr().err


def test_a_figure_is_drawn(bag, tmp_path):
    pytest.importorskip("matplotlib")
    for name in ("calibration.png", "calibration.svg"):
        out = tmp_path / f"{name}.yaml"
        arguments = [bag, "--machine", "dc_motor", "--out", out, "--figure", tmp_path / name]
        assert call(*arguments) == 0
        assert (tmp_path / name).stat().st_size > 10_000


def test_a_figure_without_matplotlib_is_refused_first(bag, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    out = tmp_path / "m.yaml"
    code = call(bag, "--machine", "dc_motor", "--out", out, "--figure", tmp_path / "a.png")
    assert code == 1
    assert "ldt[plot]" in capsys.readouterr().err
    assert not out.exists()


def test_a_real_motor_is_imported_and_calibrated(measured, tmp_path, capsys):
    """The rig's step response, cut into pieces: the error on records never fitted falls tenfold."""
    folder = measured / "rtl_dcmotor"

    def load(name, *more):
        target = tmp_path / f"{name}{len(more)}"
        fields = ["--voltage", "voltage_V", "--speed", "speed_rpm:rpm", "--time", "time_s"]
        source = str(folder / f"{name}.csv")
        assert invoke(import_file.command, [source, *fields, *more, "--out", str(target)]) == 0
        return str(target)

    step = load("open_loop_5_15V", "--length", "6")
    out = tmp_path / "rig.yaml"
    assert call(step, "--machine", "dc_motor", "--out", out) == 0
    said = capsys.readouterr().out
    assert "the physics lacks" in said
    for name in ("closed_loop_20_25_a", "closed_loop_20_25_b"):
        other, errors = load(name), []
        capsys.readouterr()
        for i, machine in enumerate(("dc_motor", out)):
            target = str(tmp_path / f"predicted_{name}_{i}")
            arguments = [other, "--machine", str(machine), "--out", target, "--json"]
            assert invoke(predict.command, arguments) == 0
            errors.append(json.loads(capsys.readouterr().out)["rmse"])
        assert errors[1] < errors[0] / 10
