"""What is fitted to absurd recordings: refused in a sentence, never named with assurance."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
import yaml

import msgs_config
from ldt_core.advice.run_up import plan_run_up
from ldt_core.base.errors import ExperimentError, LdtError, MachineFileError, OptionError
from ldt_core.base.experiment import DOUBTFUL, Experiment, Level
from ldt_core.base.metrics import FreeRunError
from ldt_core.base.settings import resolve
from ldt_core.calibration import calibrate
from ldt_core.calibration.calibration import refuse_absurd
from ldt_core.calibration.coordinates import Coordinates
from ldt_core.calibration.identifiability import Uncertainty, uncertainty
from ldt_core.calibration.identify import identify_machine
from ldt_core.calibration.torque_balance import balanced_machine, guidance
from ldt_core.cli import invoke, ldt
from ldt_core.detectors.adequacy import Adequacy
from ldt_core.effects import get_effect
from ldt_core.machine import Plant
from ldt_core.machine.current_check import wrong_current
from ldt_core.machine.machine_file import load_machine, machine_from_dict
from ldt_core.machine.sensor_check import doubt
from ldt_core.machine.unit_check import other_unit
from ldt_core.python_api.gap_diagnosis import diagnose
from ldt_core.recording.writer import BagWriter
from ldt_core.twin.loop import Twin
from tests.motors import all_but

MOTOR = replace(load_machine("dc_motor"), duration=3.0)
RANDOM = np.random.default_rng(1)


def made(count: int = 3) -> list[Experiment]:
    """Sound experiments of the small motor."""
    settings = resolve({"seed": 3, "start_time": 1e9, "degradation": "none"})
    plant = Plant.from_settings(MOTOR, settings)
    return [plant.experiment(number) for number in range(1, count + 1)]


SOUND = made()

#: Change of each experiment → (words of the sentence, exit code).
ABSURD = {
    "no voltage": (lambda e: replace(e, voltage=0 * e.voltage), "voltage is 0 V throughout", 1),
    "one voltage": (lambda e: replace(e, voltage=0 * e.voltage + 8), "8 V throughout", 1),
    "at rest": (lambda e: replace(e, speed=0 * e.speed), "speed is 0 rad/s throughout", 1),
    "at rest, as if below 0": (lambda e: replace(e, speed=-0.0 * e.speed), "speed is 0 rad", 1),
    "one speed": (lambda e: replace(e, speed=0 * e.speed + 9), "9 rad/s throughout", 1),
    "backwards": (lambda e: replace(e, speed=-e.speed), "speed falls as the voltage rises", 1),
    "noise": (lambda e: replace(e, speed=RANDOM.normal(0, 50, len(e))), "than chance would", 1),
    "squares overflow": (lambda e: replace(e, speed=1e250 * e.speed), "speed: expected sizes", 2),
    "squares vanish": (lambda e: replace(e, speed=1e-250 * e.speed), "speed: expected sizes", 2),
    "huge voltage": (lambda e: replace(e, voltage=1e250 * e.voltage), "voltage: expected size", 2),
    "period beyond all clocks": (lambda e: replace(e, period=1e-300), "sample period: expec", 2),
    "periods apart": (lambda e: replace(e, period=0.01 * e.number), "sample period: expected", 2),
    "one sample each": (lambda e: e.part(0, 1), "", 1),
    "five samples each": (lambda e: e.part(0, 5), "samples", 1),
}


@pytest.mark.parametrize("effects", ["", "coulomb_friction", "gravity_imbalance"])
@pytest.mark.parametrize("name", ABSURD)
def test_what_determines_no_motor_is_refused(name, effects):
    """By one sentence, which proposes no effects where there is nothing to tell them by."""
    change, words, code = ABSURD[name]
    given = [change(e) for e in SOUND]
    fit = (
        (lambda: balanced_machine(given, [effects], "a"))
        if effects
        else (lambda: identify_machine(given, "a"))
    )
    with np.errstate(all="raise"), pytest.raises(LdtError) as error:
        fit()
    assert words in str(error.value)
    assert error.value.exit_code == code or name == "one sample each"
    assert "--effects" not in str(error.value)


def shown_by(sensor) -> list[Experiment]:
    """A motor under steps of both signs, as a sensor shows it."""
    volts = np.repeat(np.random.default_rng(0).uniform(-12, 12, 40), 100)
    speed = np.zeros(len(volts))
    for k in range(1, len(speed)):
        speed[k] = speed[k - 1] + 0.026 * (19.2 * volts[k - 1] - speed[k - 1])
    whole = Experiment(1, 1e9, 0.01, volts, sensor(speed))
    return [replace(whole.part(500 * k, 500 * k + 500), number=k + 1) for k in range(8)]


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        (abs, "as of a sensor without direction"),
        (lambda w: np.where(abs(np.arange(4000) - 2000) < 500, w[1500], w), "that stands still"),
        (lambda w: -w, "the speed falls as the voltage rises"),
    ],
)
def test_a_sensor_s_fault_is_no_wrong_sign(sensor, words):
    """Of a gain of +34 rad/s per V, no speed falls as the voltage rises."""
    with pytest.raises(LdtError) as error:
        identify_machine(shown_by(sensor), "a")
    assert words in str(error.value)


def test_a_few_samples_do_not_show_a_pendulum():
    """Five samples of a motor have been called one, with nothing left over."""
    assert guidance([e.part(0, 5) for e in SOUND]) == ""


def test_samples_faster_than_any_converter_make_no_motor():
    """Who reads its file would refuse it."""
    fast = [replace(e, period=1e-14) for e in SOUND]
    with pytest.raises(ExperimentError, match=r"sample period: expected 1e-09"):
        identify_machine(fast, "fast")


def test_a_fit_that_ends_where_nothing_shows_has_no_interval():
    """Its information is nothing, which has no inverse; rounding has left less than nothing."""
    still = [np.zeros((50, 2))] * 3
    found = uncertainty(still, [np.ones(50)] * 3, [50] * 3, 3)
    assert np.isinf(found.errors).all()
    assert np.isinf(Uncertainty(np.diag([-1e-30, 1.0]), 9.0, "").errors[0])


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("K_t", 1e-200, r"parameters\.K_t: expected at least 1e-30"),
        ("R", 1e-300, r"parameters\.R: expected at least 1e-30"),
        ("L", 1e200, r"parameters\.L: expected at most 1e\+30"),
        ("J", {"value": 1e-3, "std": 1e-303}, r"parameters\.J\.std: expected at least 1e-30"),
        ("J", {"value": 1e-3, "std": 1e300}, r"parameters\.J\.std: expected at most 1e\+30"),
        ("voltage", [-1e308, 1e308], r"limits\.voltage: expected at most 1e\+30"),
    ],
)
def test_numbers_that_cannot_be_computed_with_are_refused(key, value, words):
    """With the file, before a square of them overflows."""
    data = yaml.safe_load(msgs_config.machine_text("dc_motor"))
    data["limits" if key == "voltage" else "parameters"][key] = value
    with pytest.raises(MachineFileError, match=words):
        machine_from_dict(data, "mine.yaml")


@pytest.mark.parametrize("speed", [0.0, -40.0, np.inf, np.nan, 1e300])
def test_a_speed_that_is_none_is_not_planned_for(speed):
    """Told as what it is, without a warning of numpy's."""
    machine = load_machine("rotor")
    with np.errstate(all="raise"), pytest.raises(OptionError, match="--reach: expected"):
        plan_run_up(machine, machine.parameters, speed)


def test_a_motor_without_a_foundation_is_told_its_voltage():
    """Nothing can capture it; its equations were asked for a foundation's mass."""
    way = plan_run_up(MOTOR, MOTOR.parameters, 100.0)
    values = MOTOR.parameters
    held = values["R"] / values["K_t"] * values["b"] * 100 + values["K_t"] * 100
    assert (way.voltage, way.through) == (pytest.approx(held), None)


def record(folder, experiments):
    """Write a recording of the small motor."""
    with BagWriter(folder, machine="dc_motor") as writer:
        for e in experiments:
            writer.write("experiment", e, e.end)
    return str(folder)


def test_an_experiment_that_comes_again_is_counted_once(tmp_path, capsys):
    """Copies were held out beside themselves, and their noise was named as an effect."""
    bag = record(tmp_path / "bag", SOUND)
    again = record(
        tmp_path / "again", [replace(SOUND[0], number=n, start=1e9 * n) for n in (1, 2, 3, 4, 5)]
    )
    out = str(tmp_path / "motor.yaml")
    assert invoke(ldt, ["identify", bag, again, bag, "--out", out]) == 0
    told = capsys.readouterr()
    assert told.err.splitlines() == [
        f"{again}: 5 experiments left out, whose samples came before: 1 (as experiment 1), "
        "2 (as experiment 1), 3 (as experiment 1) and 2 more",
        f"{bag}: 3 experiments left out, whose samples came before: 1 (as experiment 1), "
        "2 (as experiment 2) and 3 (as experiment 3)",
    ]
    assert "3 experiments fitted" in told.out


@pytest.mark.parametrize("option", [["--order", "1"], ["--no-offset"], ["--holdout", "0.5"]])
def test_options_that_change_nothing_beside_effects_are_refused(option, tmp_path, capsys):
    """They serve the motor alone."""
    bag, out = record(tmp_path / "bag", SOUND), tmp_path / "motor.yaml"
    asked = ["identify", bag, "--effects", "coulomb_friction", "--out", str(out), *option]
    assert invoke(ldt, asked) == 2
    assert "to be left out: it has no effect with --effects" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize("factor", [1e-300, 1e300])
def test_an_effect_beyond_floating_point_is_refused(factor):
    """As a machine file's numbers are; the simulation divided by a rate of 0."""
    with pytest.raises(OptionError, match=r"inertia, factor: expected a size from 1e-30"):
        get_effect("inertia").check({"factor": factor})


def test_what_rounding_leaves_is_no_change_of_the_machine():
    """A model that is right to the last bits was called changed at 1.4e-14 rad/s."""
    detector = Adequacy()
    speed = np.full(500, 100.0)
    for _ in range(5):
        detector.excited(0 * speed + 8)
        detector.measured(speed)
        detector.update(np.full(500, 1.42e-14))
        assert detector.signal is Level.NEGATIVE


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("backwards", "ran to 1000 times"),
        ("at rest", "speed is 0 rad/s throughout"),
        ("no voltage", "the fit leaves"),
        ("turned in time", "ran to 1000 times"),
        ("turned round at last", "ran to 1000 times"),
    ],
)
@pytest.mark.slow
def test_what_no_motor_does_is_no_calibration(name, words):
    """A file with the torque constant a thousand times off was written of it, with a note."""
    further = {
        "turned in time": lambda e: replace(e, speed=e.speed[::-1].copy()),
        "turned round at last": lambda e: replace(e, speed=-e.speed) if e.number > 1 else e,
    }
    change = further[name] if name in further else ABSURD[name][0]
    with pytest.raises(LdtError, match=words):
        calibrate(MOTOR, [change(e) for e in SOUND], holdout=0.0)


@pytest.mark.parametrize(("left", "fits"), [(0.49, True), (0.51, False), (0.95, False)])
def test_a_sensor_turned_round_in_half_of_the_experiments_is_no_calibration(left, fits):
    """One constant for all leaves nearly all of it, so a fit that left as much was accepted."""
    given = [replace(e, speed=-e.speed) if e.number > 2 else e for e in made(4)]
    fitted = FreeRunError()
    for e in given:
        fitted.add(left * e.speed)
    with nullcontext() if fits else pytest.raises(LdtError, match="the fit leaves"):
        refuse_absurd(Coordinates([], {}), np.zeros(0), fitted, given)


@pytest.mark.slow
def test_so_it_is_refused_where_no_parameter_runs_away():
    """Two one way and one the other: four per cent of the speed could be fitted to."""
    given = [replace(e, speed=-e.speed) if e.number > 2 else e for e in made(4)]
    with pytest.raises(LdtError, match="no calibration of the machine"):
        calibrate(MOTOR, given, holdout=0.25)


def test_a_machine_that_keeps_its_speed_is_calibrated_whatever_the_physics_lacks():
    """Refused before: next to friction without a name, a constant per experiment left less."""
    told = {"seed": 3, "start_time": 1e9, "degradation": "none", "effect": ["coulomb_friction"]}
    steady = replace(MOTOR, simulation={**MOTOR.simulation, "voltage": {"kind": "constant"}})
    plant = Plant.from_settings(steady, resolve({**told, "start": "continue"}))
    settled = [plant.experiment(number).part(150, 300) for number in (1, 2, 3)]
    assert calibrate(MOTOR, settled, holdout=0.0).lacking


@pytest.mark.parametrize(("factor", "words"), [(1000, "1000 times what"), (-1, "the wrong sign")])
def test_a_current_of_another_unit_or_sign_is_not_fitted_to(factor, words):
    """In mA it made a resistance of 0.9994 with 94 % confidence; turned round, one of 998 Ohm."""
    told = {"seed": 3, "start_time": 1e9, "degradation": "none", "measure_current": True}
    plant = Plant.from_settings(MOTOR, resolve(told))
    sound = [plant.experiment(number) for number in range(1, 5)]
    given = [replace(e, current=factor * e.current) for e in sound]
    with pytest.raises(ExperimentError, match=words):
        calibrate(MOTOR, given)
    others = all_but("armature_resistance", "motor_constant", "inertia")
    found = diagnose(given, MOTOR, without=others)
    assert found.verdict.kind == "none"
    assert words in found.notes[0]
    assert not diagnose(sound, MOTOR, without=others).notes


def test_a_failed_fit_names_the_unit_that_it_may_be():
    """A speed in rpm: it said that the free parameters hardly move the speed."""
    given = [replace(e, speed=30 / np.pi * e.speed) for e in SOUND]
    with pytest.raises(LdtError, match=r"another unit, .* import again with it"):
        calibrate(MOTOR, given)


@pytest.mark.parametrize("name", ["J", "R", "K_t", "b", "L", "J / 1000", "R / 1000", "K_t / 1000"])
def test_a_machine_file_in_another_unit_is_doubted_by_a_run(name):
    """Inertia in g m², resistance in mOhm: nothing was said, and a twin learned around it."""
    right = replace(load_machine("rotor"), duration=2.0)
    name, _, less = name.partition(" / ")
    value = right.parameters[name] * (1 / 1000 if less else 1000)
    wrong = replace(right, parameters={**right.parameters, name: value})
    made = [Plant(right, seed=1).experiment(number) for number in (1, 2)]
    assert [doubt(right, e) for e in made] == ["", ""]
    assert all("another unit" in doubt(wrong, e) for e in made)
    step = Twin(wrong, model="physics").step(made[0])
    assert "sensor or machine? the speed" in step.adaptation.reason or name == "K_t"
    assert step.adaptation.details[DOUBTFUL] == 1


def test_what_wear_and_loads_do_is_no_other_unit():
    """A tenth or ten times of each parameter, and a motor that stands still."""
    right = load_machine("rotor")
    for name in ("J", "R", "K_t", "b", "L"):
        for factor in (0.1, 10.0):
            other = {**right.parameters, name: factor * right.parameters[name]}
            made = Plant(replace(right, parameters=other), seed=1).experiment(1)
            assert other_unit(right, made) == ""
    stuck = replace(made, speed=np.random.default_rng(0).normal(0.0, 0.1, len(made)))
    assert other_unit(right, stuck) == ""


def test_a_slow_ramp_of_a_loaded_arm_is_no_other_unit():
    """Gravity turns with the arm for seconds, while the speed follows the voltage at once."""
    p = {"J": 0.04, "K_t": 1.5, "R": 1.0, "L": 0.0, "b": 0.0}
    arm = replace(load_machine("dc_motor"), parameters=p)
    period, finer = 0.002, 20
    voltage = 18.0 * np.sin(2 * np.pi * np.arange(3000) * period / 6.0)
    angle, w, speed = -np.pi / 2, 0.0, []
    for u in voltage:
        speed.append(w)
        for _ in range(finer):
            torque = p["K_t"] * (u - p["K_t"] * w) / p["R"] - 4.4 * np.cos(angle)
            w += period / finer * torque / p["J"]
            angle += period / finer * w
    assert other_unit(arm, Experiment(1, 0.0, period, voltage, np.array(speed))) == ""


def test_a_speed_of_the_other_sign_is_doubted_by_a_run():
    """Calibration and diagnosis said it; a twin learned half of it."""
    right = load_machine("dc_motor")
    made = Plant(right, seed=1).experiment(1)
    assert doubt(right, made) == ""
    assert "one of the two has the other sign" in doubt(right, replace(made, speed=-made.speed))


def test_a_dead_current_sensor_is_not_fitted_to():
    """Zero throughout: a resistance a thousand times the file's was."""
    dead = [replace(e, current=0 * e.speed) for e in SOUND]
    assert "0 A to the last digit" in wrong_current(MOTOR, dead)
    with pytest.raises(LdtError, match="0 A to the last digit"):
        calibrate(MOTOR, dead)


def test_one_sample_teaches_nothing():
    """It was an index error of numpy's."""
    step = Twin(MOTOR).step(SOUND[0].part(0, 1))
    assert step.adaptation.reason.startswith("nothing is learned: one sample shows no change")
