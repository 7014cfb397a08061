"""What a machine that is no motor may be instead, by the balance of its accelerations."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

import ldt_core as ldt
from ldt_core.base.errors import LdtError, OptionError
from ldt_core.base.experiment import Experiment
from ldt_core.calibration import calibrate
from ldt_core.calibration.torque_balance import (
    balance,
    balanced_machine,
    balanced_start,
    check_balanced,
    fitting,
    guidance,
)
from ldt_core.cli.identify import command
from ldt_core.machine.machine_file import load_machine
from ldt_core.models.physics import PhysicsModel
from ldt_core.python_api.simulated_experiments import simulate as simulated
from ldt_core.recording.writer import BagWriter

PERIOD, SUBSTEPS = 0.01, 20


def swung(gravity=60.0, friction=0.0, samples=3000, noise=0.01, seed=1, drag=0.0):
    """An experiment of a motor by Euler's rule in short steps: a pendulum that hangs at first."""
    random = np.random.default_rng(seed)
    volts = np.repeat(random.uniform(-3, 3, samples // 60), 60)
    angle = speed = 0.0
    seen = np.empty(samples)
    for k in range(samples):
        seen[k] = speed
        for _ in range(SUBSTEPS):
            torque = 20.0 * volts[k] - 1.5 * speed - gravity * np.sin(angle)
            torque -= friction * np.tanh(speed / 0.05) + drag * speed * abs(speed)
            speed += PERIOD / SUBSTEPS * torque
            angle += PERIOD / SUBSTEPS * speed
    return Experiment(1, 0.0, PERIOD, volts, seen + noise * random.standard_normal(samples))


@pytest.mark.parametrize(
    ("truth", "names"),
    [
        ({"gravity": 0.0}, None),
        ({"gravity": 60.0}, ("gravity_imbalance",)),
        ({"gravity": 60.0, "friction": 8.0}, ("gravity_imbalance", "coulomb_friction")),
        ({"gravity": 0.0, "friction": 12.0}, ("coulomb_friction",)),
    ],
)
def test_the_kind_of_machine_is_told_from_its_accelerations(truth, names):
    """A motor alone, a pendulum, dry friction, or both; amounts within a tenth."""
    found = fitting([swung(**truth)])
    if names is None:
        assert found is None
        assert guidance([swung(**truth)]) == ""
        return
    assert found.effects == names
    assert found.gain == pytest.approx(20.0, rel=0.1)
    if truth.get("gravity"):
        assert found.amounts["gravity_imbalance"]["torque"] == pytest.approx(60.0, rel=0.1)
        assert found.amounts["gravity_imbalance"]["phase"] == pytest.approx(-np.pi / 2, abs=0.1)
    if "friction" in truth:
        assert found.amounts["coulomb_friction"]["torque"] == pytest.approx(
            truth["friction"], rel=0.15
        )


@pytest.mark.slow
@pytest.mark.parametrize(("gravity", "kind"), [(0.0, ()), (30.0, ("gravity_imbalance",))])
def test_a_torque_that_differs_by_the_experiment_is_no_pendulum(gravity, kind):
    """A machine has one torque of gravity; what dry friction leaves is not taken for it."""
    whole = swung(gravity, friction=12.0, samples=6000, noise=0.1, seed=2)
    cut = [
        Experiment(k + 1, 10.0 * k, PERIOD, whole.voltage[part], whole.speed[part])
        for k, part in enumerate(slice(b, b + 1000) for b in range(0, 6000, 1000))
    ]
    assert fitting(cut).effects == (*kind, "coulomb_friction")


@pytest.mark.parametrize("effect", ["cogging_torque", "input_delay:delay=0.2", "load_friction"])
def test_what_a_pendulum_or_friction_imitates_a_little_is_not_called_one(effect):
    """It took away a fifth of the squares, and "a motor with a pendulum fits" was said."""
    made = simulated("dc_motor", 8, effects=[effect], seed=1)
    assert fitting(made) is None
    assert guidance(made) == ""


def test_its_file_runs_nearly_as_the_machine_does():
    """By accelerations alone, before any fit in free run."""
    measured = [swung(samples=600)]
    machine = balanced_start(
        balance(measured, ["gravity_imbalance"]), "pendulum", measured, (-4, 4)
    )
    predicted = PhysicsModel(machine).predict(measured[0]).speed
    left = np.sqrt(np.mean((predicted - measured[0].speed) ** 2))
    assert left < 0.3 * measured[0].speed.std()


@pytest.mark.slow
def test_identify_says_the_command_and_the_command_works(tmp_path):
    """From `ldt identify BAG` to a machine file with gravity in it."""
    bag, out = tmp_path / "bag", tmp_path / "pendulum.yaml"
    with BagWriter(bag, machine="pendulum") as writer:
        experiment = swung()
        writer.write("experiment", experiment, experiment.end)
    first = CliRunner().invoke(command, [str(bag), "--out", str(tmp_path / "motor.yaml")])
    said = first.output + str(first.exception)
    assert "a pendulum" in said
    assert "--effects gravity_imbalance" in said
    asked = [str(bag), "--effects", "gravity_imbalance", "--out", str(out)]
    done = CliRunner().invoke(command, asked)
    assert done.exit_code == 0, done.output
    assert load_machine(out).acting == ("gravity_imbalance",)
    assert yaml.safe_load(out.read_text())["effects"][0]["parameters"]["torque"]["value"] > 0


def test_a_calibration_fits_the_torques_that_were_found():
    """An estimate is not exact: kept, it would bend the other parameters and their intervals."""
    told = {"coulomb_friction": {"torque": 0.02}}
    measured = ldt.simulate("dc_motor", 8, effects=told, seed=3, noise=0.1)
    machine = balanced_machine(measured, ["coulomb_friction"], "motor")
    motor = load_machine("dc_motor").parameters
    # By convention R = 1 Ohm and b = 0: every torque is on the scale of that motor.
    scale = 1 + motor["b"] * motor["R"] / motor["K_t"] ** 2
    estimates = {e.name: e for e in calibrate(machine, measured).estimates}
    for name, true in (("coulomb_friction.torque", 0.02 * scale), ("R", 1.0)):
        low, high = estimates[name].ci95
        assert low < true < high


def test_no_command_is_proposed_that_would_be_refused():
    """A pendulum that swings by itself: nothing tells what a volt does."""
    e = swung(noise=0.1)
    free = replace(e, voltage=np.random.default_rng(2).permutation(e.voltage))
    assert "ldt identify" not in guidance([free])
    assert "record experiments that the voltage drives" in guidance([free])
    with pytest.raises(LdtError, match="no more of the speed's changes than chance"):
        balanced_machine([free], ["gravity_imbalance"], "pendulum")


def stopped(friction=2.0):
    """A geared motor whose shaft friction holds at up to 2 of 9 V, as an encoder shows it."""
    volts = np.repeat([0, 1, 2, -1, -2, 0, 4, 6, 9, 0, -4, -6, -9, 0.0], 150)
    speed, seen = 0.0, np.empty(volts.size)
    for k in range(volts.size):
        seen[k] = speed
        for _ in range(SUBSTEPS):
            pull = PERIOD / SUBSTEPS * (9.0 * volts[k] - 2.5 * speed)
            brake = PERIOD / SUBSTEPS * 9.0 * friction
            speed = np.sign(speed + pull) * max(abs(speed + pull) - brake, 0.0)
    return Experiment(1, 0.0, PERIOD, volts, np.round(seen / 0.05) * 0.05)


def test_a_shaft_that_friction_holds_does_not_hide_the_friction():
    """Its standing still was taken for a voltage without effect, and the friction for a third."""
    measured = stopped()
    found = fitting([measured])
    assert found is not None
    assert found.effects == ("coulomb_friction",)
    assert found.amounts["coulomb_friction"]["torque"] == pytest.approx(18.0, rel=0.1)
    assert found.gain == pytest.approx(9.0, rel=0.1)
    machine = balanced_machine([measured], ["coulomb_friction"], "geared")
    predicted = PhysicsModel(machine).predict(measured).speed
    assert np.sqrt(np.mean((predicted - measured.speed) ** 2)) < 0.05 * measured.speed.std()


def test_friction_that_would_have_to_drive_is_none():
    """As the drag of a fan looks to a balance: neither proposed nor written, as friction of 0."""
    fan = [swung(gravity=0.0, drag=0.05)]
    assert balance(fan, ["coulomb_friction"]).left < 0.8 * balance(fan, []).left
    assert fitting(fan) is None
    with pytest.raises(LdtError, match="no dry friction"):
        balanced_machine(fan, ["coulomb_friction"], "fan")


def test_an_unknown_effect_is_refused():
    with pytest.raises(OptionError, match="effects"):
        check_balanced(["gravity"])


def test_work_and_memory_grow_with_the_experiments_not_by_their_square():
    """Each has an angle of its own; 5000 short ones took 17 GB."""
    whole = swung(gravity=30.0)
    parts = [whole.part(k, k + 60) for k in range(0, 2940, 60)] * 8
    tracemalloc.start()
    found = balance(parts, ("gravity_imbalance",), 4)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40 * sum(e.speed.nbytes for e in parts)  # 16; all side by side, 800
    once = balance(parts[: len(parts) // 8], ("gravity_imbalance",), 4)
    assert found.amounts["gravity_imbalance"] == pytest.approx(once.amounts["gravity_imbalance"])
    assert (found.gain, found.left) == pytest.approx((once.gain, once.left))
