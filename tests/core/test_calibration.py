"""Calibration recovers known machines and says what it cannot know."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ldt_core.base.errors import ExperimentError, LdtError, OptionError
from ldt_core.base.experiment import Experiment
from ldt_core.calibration import calibrate
from ldt_core.calibration.calibration_runs import CalibrationRuns
from ldt_core.calibration.held_out import split_evenly
from ldt_core.calibration.identifiability import identifiability, product, uncertainty
from ldt_core.calibration.machine_yaml import machine_file_text
from ldt_core.machine.machine_file import load_machine, parse_machine

MOTOR = load_machine("dc_motor")
TRUE = MOTOR.with_parameters(J=0.0015, K_t=0.06, R=1.3, L=0.0015, b=0.00015)


def measured(
    machine, count, samples=400, noise=0.1, current=False, seed=1, ar=0.0, levels=(4, 12), hold=50
):
    """Experiments of a machine: random steps of the voltage, noise with AR(1) coefficient `ar`."""
    rng = np.random.default_rng(seed)
    experiments = []
    for number in range(1, count + 1):
        volts = np.repeat(rng.uniform(*levels, samples // hold + 1), hold)[:samples]
        start = machine.model.initial_state(machine.parameters, 20 * rng.uniform())
        states = machine.model.simulate(machine.parameters, volts, machine.sample_period, start)
        error = rng.standard_normal(samples)
        for k in range(1, samples):
            error[k] = ar * error[k - 1] + math.sqrt(1 - ar**2) * error[k]
        amperes = states[:, 2] + 0.02 * rng.standard_normal(samples) if current else None
        experiments.append(
            Experiment(
                number, 0.0, machine.sample_period, volts, states[:, 1] + noise * error, amperes
            )
        )
    return experiments


def found(calibration):
    return {e.name: e for e in calibration.estimates}


def test_current_and_speed_determine_all_five_parameters_of_a_motor():
    """From a start up to 33 % off, all five come back within their intervals of about 1 %."""
    result = calibrate(MOTOR, measured(TRUE, 6, current=True))
    assert set(found(result)) == {"J", "K_t", "R", "L", "b"}
    assert not result.undetermined
    for name, tolerance in (("J", 0.005), ("K_t", 0.005), ("R", 0.005), ("L", 0.1), ("b", 0.02)):
        estimate = found(result)[name]
        assert estimate.value == pytest.approx(TRUE.parameters[name], rel=tolerance)
        assert estimate.ci95[1] - estimate.ci95[0] < 2 * tolerance * estimate.value


def test_speed_alone_determines_three_combinations():
    """Gain and two time constants are right whatever R and b are kept at; J R is found, not J."""
    result = calibrate(MOTOR, measured(TRUE, 6))
    assert set(found(result)) == {"J", "K_t", "L"}
    assert [set(g) for g in result.undetermined] == [{"J", "K_t", "R", "L", "b"}]
    assert set(result.fixed) == {"R", "b"}

    def combinations(values):
        j, k, r, inductance, b = (values[n] for n in ("J", "K_t", "R", "L", "b"))
        whole = r * b + k * k
        return k / whole, (r * j + inductance * b) / whole, inductance * j / whole

    for got, true, tolerance in zip(
        combinations(result.machine.parameters),
        combinations(TRUE.parameters),
        (0.001, 0.001, 0.2),
        strict=True,
    ):
        assert got == pytest.approx(true, rel=tolerance)
    sentence = next(n for n in result.notes if "cannot separate R, " in n)
    assert "kept at 1 Ohm" in sentence
    assert "J changes by -1 %" in sentence
    assert "L / R" in " ".join(result.notes)


def test_freeing_too_much_gives_values_without_intervals():
    """All five freed from speed alone: fits as well, stays at the file where nothing is known."""
    result = calibrate(MOTOR, measured(TRUE, 6), free=["J", "K_t", "R", "L", "b"])
    assert all(e.ci95 is None for e in result.estimates)
    assert found(result)["R"].value == MOTOR.parameters["R"]
    assert len(found(result)) == 5
    before, after = result.errors["held_out"]
    assert after.rmse < 0.12 < 5 < before.rmse


def test_the_free_run_error_goes_to_the_noise():
    """Fitted and held-out error after are the noise of 0.1 rad/s; before it was 100 times that."""
    result = calibrate(MOTOR, measured(TRUE, 8, samples=600))
    for before, after in result.errors.values():
        assert before.rmse > 5
        assert after.rmse == pytest.approx(0.1, rel=0.35)
    assert result.noise["speed"] == pytest.approx(0.1, rel=0.05)
    assert len(result.experiments["held_out"]) == 2


def test_a_wrong_first_sample_does_not_bias_the_parameters():
    """Start states are estimated: one bad first sample in each experiment moves K_t by no 0.1 %."""
    spoiled = []
    for e in measured(TRUE, 4):
        speed = e.speed.copy()
        speed[0] += 3.0
        spoiled.append(replace(e, speed=speed))
    result = calibrate(MOTOR, spoiled, fixed=["R", "b"], holdout=0)
    clean = calibrate(MOTOR, measured(TRUE, 4), fixed=["R", "b"], holdout=0)
    assert found(result)["K_t"].value == pytest.approx(found(clean)["K_t"].value, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "samples", "ar"), [(3, 300, 0.0), (8, 150, 0.9)])
def test_intervals_cover_the_truth(count, samples, ar):
    """Of 20 recordings, the 95 % intervals miss the truth in at most 5, white noise or AR(1).

    With a coverage of 95 % more than 5 misses happen 3 times in 10,000 (binomial). Intervals are
    withheld by chance in one recording of twenty: in more than 4 of 20 once in 400 times. Taking
    AR(1) noise of 0.9 for white makes intervals 3.6 times too narrow: more than 5 miss then.
    """
    true = MOTOR.with_parameters(J=0.0013, K_t=0.055)
    hits, given = dict.fromkeys(("J", "K_t"), 0), 0
    for seed in range(20):
        experiments = measured(true, count, samples, noise=1.0, ar=ar, seed=seed, hold=30)
        result = calibrate(MOTOR, experiments, free=["J", "K_t"], holdout=0)
        given += result.lacking == []
        for name in hits if result.lacking == [] else ():
            low, high = found(result)[name].ci95
            hits[name] += low <= true.parameters[name] <= high
    assert given >= 16
    assert min(hits.values()) >= given - 5, hits


@pytest.mark.slow
def test_the_eccentricity_of_a_rotor_is_recovered():
    """From a file with e = 0, the free run of 2 experiments gives e = 4 mm within 0.5 %."""
    rotor = load_machine("rotor")
    experiments = measured(
        rotor.with_parameters(e=0.004), 2, samples=1500, levels=(6, 16), hold=100
    )
    result = calibrate(rotor, experiments, free=["e"])
    assert found(result)["e"].value == pytest.approx(0.004, rel=0.005)
    assert found(result)["e"].ci95[0] > 0.0039
    assert result.errors["fit"][1].rmse < 0.2 < result.errors["fit"][0].rmse


def test_an_ideal_rotor_says_that_its_foundation_does_not_show():
    """With e = 0 the foundation does not feel the rotor; nothing of it is fitted."""
    rotor = load_machine("rotor")
    result = calibrate(rotor, measured(rotor, 2, levels=(6, 16)))
    assert {"m", "M", "K_x", "K_y", "R_x", "R_y"} <= set(result.fixed)
    assert any("K_x" in n and "not show" in n for n in result.notes)
    assert any("already fit" in n for n in result.notes)


def test_a_machine_at_rest_determines_nothing():
    """No voltage, no motion: one sentence, no numbers."""
    still = [Experiment(1, 0.0, 0.01, np.zeros(100), np.zeros(100))]
    with pytest.raises(LdtError, match=r"nothing to calibrate.*0 V throughout"):
        calibrate(MOTOR, still)


def test_steady_running_determines_no_inertia():
    """Constant voltage at constant speed says nothing of J, and the error says so."""
    volts = np.full(300, 8.0)
    b, k, r = (TRUE.parameters[n] for n in ("b", "K_t", "R"))
    speed = np.full(300, 8 * k / (r * b + k * k))
    noisy = speed + 0.1 * np.random.default_rng(0).standard_normal(300)
    with pytest.raises(LdtError, match="8 V throughout"):
        calibrate(TRUE, [Experiment(1, 0.0, 0.01, volts, noisy)], free=["J"])


def test_a_parameter_that_ends_on_its_bound_is_named():
    """A machine faster than 1 / K_t allows, with K_t fixed, drives the friction to 0."""
    fast = MOTOR.with_parameters(K_t=0.04, b=0)
    result = calibrate(MOTOR, measured(fast, 4), free=["J", "b"])
    assert any("b ended at 0 N m s" in n for n in result.notes)


def test_what_the_physics_lacks_is_not_called_noise():
    """A constant load that dc_motor does not have leaves a smooth rest, and a sentence about it."""
    loaded = []
    for e in measured(TRUE, 4, noise=0.01):
        loaded.append(replace(e, speed=e.speed - 15 * (1 + 0.3 * np.sin(e.time))))
    result = calibrate(MOTOR, loaded)
    assert any("the physics lacks" in n for n in result.notes)


def test_an_experiment_outside_the_limits_is_refused():
    """30 V on a machine for 24 V."""
    bad = Experiment(7, 0.0, 0.01, np.full(50, 30.0), np.zeros(50))
    with pytest.raises(ExperimentError, match="experiment 7, voltage"):
        calibrate(MOTOR, [bad])


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"free": ["Kt"]}, "did you mean 'K_t'"),
        ({"fixed": ["Q"]}, "--fixed"),
        ({"free": ["J"], "fixed": ["R"]}, "not both|both"),
        ({"fixed": ["J", "K_t", "R", "L", "b"]}, "leaves a parameter free"),
        ({"holdout": 1.0}, "--holdout"),
        ({"holdout": 0.99}, "--holdout"),
    ],
)
def test_wrong_options_get_a_sentence(options, expected):
    with pytest.raises(OptionError, match=expected):
        calibrate(MOTOR, measured(TRUE, 2, samples=50), **options)


def test_runs_side_by_side_are_the_runs_one_by_one():
    """The sum of squares is that of each experiment simulated alone."""
    machine = load_machine("rotor").with_parameters(e=0.005)
    physics, values = machine.model, machine.parameters
    recorded = measured(machine, 3, samples=200, current=True)
    runs = CalibrationRuns(physics, values, recorded)
    expected = 0.0
    for e in recorded:
        start = physics.initial_state(values, e.speed[0], e.current[0])
        states = physics.simulate(values, e.voltage, e.period, start)
        for shown, column, noise in zip((e.speed, e.current), (1, 2), runs.noise, strict=True):
            expected += float(np.sum(((shown - states[:, column]) / noise) ** 2))
    assert runs.loss(values) == pytest.approx(expected, rel=1e-12)


def test_held_out_experiments_cover_the_recording():
    """A quarter of 12: three, spread, and nobody is in both parts."""
    experiments = measured(TRUE, 12, samples=20)
    kept, held, note = split_evenly(experiments, None)
    assert ([e.number for e in held], note) == ([3, 7, 11], [])
    assert sorted(e.number for e in kept + held) == list(range(1, 13))
    assert split_evenly(experiments[:3], None)[1] == []


def test_the_same_recording_gives_the_same_bits():
    """Twice the same calibration: every number equal."""
    experiments = measured(TRUE, 4)
    assert calibrate(MOTOR, experiments).as_dict() == calibrate(MOTOR, experiments).as_dict()


def test_the_machine_file_reads_back():
    """The text is a machine file of the same name with the calibrated values and their story."""
    result = calibrate(MOTOR, measured(TRUE, 4)).with_recordings(["a: bag #1"])
    again = parse_machine(machine_file_text(result), "out.yaml")
    assert again.parameters == result.machine.parameters
    assert again.name == MOTOR.name
    assert again.simulation == MOTOR.simulation
    assert again.calibration == result.as_dict()
    assert again.calibration["recordings"] == ["a: bag #1"]
    assert "# kg m^2" in machine_file_text(result)


def test_dependent_columns_are_grouped_with_their_exponents():
    """Columns x, y and 2x - y: the third is a product of the first two; a zero column is silent."""
    rng = np.random.default_rng(0)
    x, y = rng.standard_normal((2, 500)) * 100
    seen = identifiability(["x", "y", "z", "o"], np.column_stack([x, y, 2 * x - y, 0 * x]))
    assert len(seen.determined) == 2
    assert seen.silent == ("o",)
    assert seen.clusters == [["x", "y", "z"], ["o"]]
    assert product({"J": 1, "R": 1.02, "K_t": -2}) == "J R / K_t^2"


def test_an_experiment_that_holds_all_information_is_no_cluster():
    """Eight experiments of which one shows the parameter: their scatter gives no interval."""
    rng = np.random.default_rng(0)
    s = [np.full((50, 1), 100.0 if i == 3 else 0.1) for i in range(8)]
    r = [rng.standard_normal(50) for _ in s]
    assert "stationary" in uncertainty(s, r, [50] * 8, 0).method
    alike = [np.ones((50, 1))] * 8
    spread = uncertainty(alike, r, [50] * 8, 0)
    assert "cluster" in spread.method
    assert spread.errors[0] == pytest.approx(1 / 20, rel=0.7)


def test_noise_alone_is_no_motor():
    """Samples that no motor made give a sentence, not a machine file."""
    rng = np.random.default_rng(0)
    volts = np.repeat([5.0, 8.0, 3.0], 30)
    noise = [Experiment(1, 0.0, 0.01, volts, 5 * rng.standard_normal(90))]
    with pytest.raises(LdtError, match="nothing to calibrate"):
        calibrate(MOTOR, noise)


@pytest.mark.slow
def test_a_healthy_rotor_has_no_eccentricity():
    """Freed on a rotor without it, e stays at 0 and is said not to show."""
    rotor = load_machine("rotor")
    healthy = measured(rotor, 1, samples=1000, levels=(6, 16), hold=100)
    result = calibrate(rotor, healthy, free=["e"])
    assert found(result)["e"].value == 0
    assert found(result)["e"].ci95 is None


def differenced(count, seed):
    """Experiments of a motor whose speed is the difference of an encoder's angles, under ramps."""
    rng, period = np.random.default_rng(seed), MOTOR.sample_period
    found = []
    for number in range(1, count + 1):
        volts = np.interp(np.arange(400) / 50, np.arange(9), [0, *rng.uniform(-12, 12, 8)])
        states = MOTOR.model.simulate(MOTOR.parameters, volts, period, np.zeros(3))
        speed = np.diff(states[:, 0], prepend=0.0) / period
        found.append(
            Experiment(number, 0.0, period, volts, speed + 0.02 * rng.standard_normal(400))
        )
    return found


@pytest.mark.parametrize("seed", [1, 2])
def test_what_is_fitted_is_not_said_to_be_lacking(seed):
    """The speed is half a sample late. "motor constant" was in what is left, by its bend alone.

    So K_t was twice as open to the next diagnosis as the friction makes it, which does not show.
    """
    result = calibrate(MOTOR, differenced(6, seed), holdout=0.0)
    assert "input_delay" in result.lacking
    changed = {"inertia", "motor_constant", "armature_resistance", "armature_inductance"}
    assert changed.isdisjoint(result.lacking)
    assert result.posterior.deviations["K_t"] < 0.01
