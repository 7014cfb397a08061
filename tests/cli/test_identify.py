"""`ldt identify`: a machine file for a machine of which nothing is known but its recordings."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from ldt_core.base.experiment import Experiment
from ldt_core.cli import import_file, invoke, predict
from ldt_core.cli.identify import command
from ldt_core.effects import parse_effect
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.writer import BagWriter

MOTOR = load_machine("dc_motor")
SLOW = MOTOR.with_parameters(J=0.002, K_t=0.08, R=0.7, L=0.03)  # both time constants show


def record(path, machine=SLOW, count=8, effect=None, sign=1, volts=(4, 12), current=False):
    """Steps of voltage, noise of 0.1 rad/s; the last experiments start while it turns."""
    rng, uses = np.random.default_rng(5), [parse_effect(effect)] if effect else []
    physics, values = machine.model, machine.parameters
    with BagWriter(str(path), machine="unknown") as writer:
        for number in range(1, count + 1):
            u = np.repeat(rng.uniform(*volts, 17), 50)
            states = physics.simulate(values, u, 0.01, physics.initial_state(values, 0.0), uses)
            kept = slice(250, None) if number > count // 2 else slice(0, 600)
            speed = sign * physics.measure(states, 0.01, uses) + 0.1 * rng.standard_normal(850)
            amperes = states[kept, 2] if current else None
            e = Experiment(number, 10.0 * number, 0.01, u[kept], speed[kept], amperes)
            writer.write("experiment", e, e.end)
    return str(path)


def answer(machine):
    """Gain, tau_m and tau_e of a machine file's motor."""
    k, r, inductance, j, b = (machine.parameters[n] for n in ("K_t", "R", "L", "J", "b"))
    stiff = r * b + k * k
    tau_m = (r * j + inductance * b) / stiff
    return k / stiff, tau_m, inductance * j / stiff / tau_m


def call(*arguments):
    return invoke(command, [str(a) for a in arguments])


def identified(tmp_path, *arguments, **recording):
    bag, out = record(tmp_path / "bag", **recording), tmp_path / "unknown.yaml"
    assert call(bag, "--out", out, *arguments) == 0
    return bag, out, load_machine(out)


@pytest.mark.parametrize("volts", [(4, 12), (-12, 12)])
def test_gain_and_time_constants_are_recovered(tmp_path, volts):
    """Within 1 %, from a motor whose R and b are not those of the equivalent one."""
    _, _, machine = identified(tmp_path, volts=volts)
    assert machine.physics == "dc_motor"
    assert machine.parameters["R"] == 1
    assert machine.parameters["b"] == 0
    np.testing.assert_allclose(answer(machine), answer(SLOW), rtol=0.01)


def test_a_motor_that_oscillates_is_one_as_well(tmp_path, capsys):
    """A large inductance makes the time constants complex; the equivalent motor has them."""
    swinging = MOTOR.with_parameters(L=0.3)
    _, _, machine = identified(tmp_path, machine=swinging)
    np.testing.assert_allclose(answer(machine), answer(swinging), rtol=0.01)
    assert "complex" in capsys.readouterr().out


def test_one_time_constant_is_enough(tmp_path, capsys):
    """--order 1 gives an inductance that is positive and does nothing."""
    fast = MOTOR.with_parameters(L=1e-5)
    _, _, machine = identified(tmp_path, "--order", "1", machine=fast)
    np.testing.assert_allclose(answer(machine)[:2], answer(fast)[:2], rtol=0.01)
    assert machine.parameters["L"] == pytest.approx(1e-4)
    assert "one time constant" in capsys.readouterr().out


def test_the_file_predicts_what_it_was_made_from_and_more(tmp_path, capsys):
    """Through `ldt predict`: nothing but the noise is left, and the same error as was printed."""
    bag, out, machine = identified(tmp_path, "--name", "press", "--json")
    shown = json.loads(capsys.readouterr().out)
    assert machine.name == shown["machine"] == "press"
    arguments = [bag, "--machine", str(out), "--out", str(tmp_path / "predicted"), "--json"]
    assert invoke(predict.command, arguments) == 0
    rmse = json.loads(capsys.readouterr().out)["rmse"]
    assert rmse < 0.12
    samples = {True: 0, False: 0}
    for number in range(1, 9):
        samples[number in shown["held_out"]["experiments"]] += 600
    squares = samples[False] * shown["rmse"] ** 2 + samples[True] * shown["held_out"]["rmse"] ** 2
    assert math.sqrt(squares / 4800) == pytest.approx(rmse, rel=1e-4)
    written = machine.calibration
    assert {k: v for k, v in shown.items() if k not in ("machine", "out", "parameters")} == written
    assert written["recordings"] == [bag]


def test_the_file_says_what_its_values_are(tmp_path):
    """Comments on convention and equivalents; name of the file; the rest from the recording."""
    _, out, machine = identified(tmp_path)
    assert machine.name == "unknown"
    text = out.read_text()
    assert "only their ratios count" in text
    assert "by convention" in text
    assert machine.voltage_limits[0] < 0
    assert 12 < machine.voltage_limits[1] < 20
    assert machine.duration == 6
    assert machine.sample_period == 0.01
    assert machine.simulation["noise"] == pytest.approx(0.1, rel=0.05)


def test_friction_does_not_distort_the_gain(tmp_path, capsys):
    """It offsets the steady speed, which is said; without an offset the gain takes it in."""
    bag, out, machine = identified(tmp_path, effect="coulomb_friction:torque=0.05")
    np.testing.assert_allclose(answer(machine), answer(SLOW), rtol=0.01)
    said = capsys.readouterr().out
    assert "off gain times voltage" in said
    assert "Or keep this file, and let `ldt diagnose` say what it lacks." in said
    assert "Next, what the motor lacks: ldt diagnose" in said
    assert call(bag, "--out", out, "--no-offset", "--force") == 0
    assert answer(load_machine(out))[0] < 0.97 * answer(SLOW)[0]


def test_a_recorded_current_is_pointed_to(tmp_path, capsys):
    """It would determine the motor's own values, by `ldt calibrate`."""
    identified(tmp_path, current=True)
    assert "ldt calibrate" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("recording", "words"),
    [
        (
            {"sign": -1},
            ["no motor", "the speed falls as the voltage rises", "turn it and import again"],
        ),
        (
            {"effect": "torsional_compliance:share=0.5,stiffness=0.05,damping=0.0001"},
            ["no motor", "order 4", "±", "more than two time constants"],
        ),
        ({"machine": SLOW.with_parameters(J=3.0)}, ["no motor", "show the beginning only"]),
        ({"volts": (8, 8)}, ["cannot determine a linear model"]),
    ],
)
def test_what_is_no_motor_is_refused_with_what_was_found(tmp_path, capsys, recording, words):
    """One sentence, and no file."""
    bag, out = record(tmp_path / "bag", **recording), tmp_path / "unknown.yaml"
    assert call(bag, "--out", out) == 1
    shown = capsys.readouterr()
    for word in words:
        assert word in shown.err
    assert shown.err.count("\n") == 1
    assert shown.out == ""
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--holdout", "2"], "--holdout"),
        (["--name", ""], "--name"),
        (["--order", "3"], "--order"),
        (["--limits", "24"], "--limits"),
        (["--limits", "24,-24"], "--limits"),
        (["--limits", "0,5"], "voltage: expected 0 to 5 V"),
        (["--namespace", "press"], "/press"),
    ],
)
def test_what_cannot_be_used_is_said_in_a_sentence(tmp_path, capsys, arguments, words):
    """Exit code 2."""
    bag, out = record(tmp_path / "bag", count=2), tmp_path / "unknown.yaml"
    assert call(bag, "--out", out, *arguments) == 2
    assert words in capsys.readouterr().err
    assert not out.exists()


def test_a_file_that_exists_is_kept(tmp_path, capsys):
    """Unless --force is given."""
    out = tmp_path / "unknown.yaml"
    out.write_text("mine")
    assert call(record(tmp_path / "bag", count=2), "--out", out) == 2
    assert "--force" in capsys.readouterr().err
    assert out.read_text() == "mine"


def test_a_real_motor_is_identified(measured, tmp_path, capsys):
    """The rig's open-loop step: on records never seen, ten times nearer than the default file."""
    fields = ["--voltage", "voltage_V", "--speed", "speed_rpm:rpm", "--time", "time_s"]
    bags = []
    for name in ("open_loop_5_15V", "closed_loop_20_25_a"):
        source, bag = measured / "rtl_dcmotor" / f"{name}.csv", str(tmp_path / name)
        assert invoke(import_file.command, [str(source), *fields, "--out", bag]) == 0
        bags.append(bag)
    out, errors = tmp_path / "rig.yaml", []
    assert call(bags[0], "--out", out, "--no-offset", "--limits", "-24,24") == 0
    capsys.readouterr()
    for i, machine in enumerate(("dc_motor", out)):
        arguments = [bags[1], "--machine", str(machine), "--out", str(tmp_path / str(i)), "--json"]
        assert invoke(predict.command, arguments) == 0
        errors.append(json.loads(capsys.readouterr().out)["rmse"])
    assert errors[1] < errors[0] / 10


def changing(path, after):
    """Twelve experiments of a motor whose constant is another in the last six."""
    rng, before = np.random.default_rng(5), MOTOR.with_parameters(L=1e-5)
    with BagWriter(str(path), machine="press") as writer:
        for number in range(1, 13):
            machine = before if number < 7 else before.with_parameters(K_t=after)
            u = np.repeat(rng.uniform(4, 12, 12), 50)
            physics, values = machine.model, machine.parameters
            states = physics.simulate(values, u, 0.01, physics.initial_state(values, 0.0), [])
            speed = physics.measure(states, 0.01, []) + 0.1 * rng.standard_normal(600)
            e = Experiment(number, 10.0 * number, 0.01, u, speed)
            writer.write("experiment", e, e.end)
    return str(path)


def test_a_machine_that_changed_meanwhile_is_told_as_one(tmp_path, capsys):
    """Its noise is the sensor's alone; its file has the name that a diagnosis asks for."""
    constant, out = MOTOR.parameters["K_t"], tmp_path / "found.yaml"
    assert call(changing(tmp_path / "far", 1.1 * constant), "--out", out) == 1
    assert "or it changed meanwhile" in capsys.readouterr().err
    bag = changing(tmp_path / "bag", 1.03 * constant)
    assert call(bag, "--out", out) == 0
    said, found = capsys.readouterr().out, load_machine(out)
    assert "The machine may have changed: a motor of the first half alone leaves" in said
    assert f"find what changed, and when: ldt run --play {bag} --machine {out} --diagnose" in said
    assert found.name == "press"
    assert found.simulation["noise"] == pytest.approx(0.1, rel=0.1)
    assert "the recorded range and a fifth more" in said
    assert call(bag, "--out", out, "--limits=-24,24", "--force") == 0
    assert "a fifth more" not in capsys.readouterr().out
