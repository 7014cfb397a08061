"""Machines of other engines, with files that were calibrated on their noisy records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded_machines import steps
from scipy.integrate import solve_ivp

from ldt_core.base.experiment import Experiment
from ldt_core.calibration.calibrate import calibrate
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.effects import get_effect
from tests.motors import motor_file
from tests.mujoco_causes import CASES, answer, right

# A small brushed motor whose current settles in a sixth of a millisecond.
TRUE = {"J": 2e-3, "K_t": 0.038, "R": 0.6, "L": 1e-4, "b": 2e-4}
PERIOD, SAMPLES, NOISE = 0.02, 250, 0.1  # s, of an experiment, rad/s
TRIED = (
    *("viscous_friction", "coulomb_friction", "motor_constant", "inertia", "constant_load"),
    *("gravity_imbalance", "quadratic_drag", "input_deadzone"),
)


def records(random, values, torque=lambda angle, speed: 0.0, count=4, volts=12.0, noise=NOISE):
    """Experiments from rest, of a motor with a further torque on its shaft [N m]."""
    found = []
    for k in range(count):
        u = steps(random, SAMPLES, -volts, volts, 50)
        state, speed = np.zeros(2), np.empty(SAMPLES)
        for i in range(SAMPLES):
            speed[i] = state[1]

            def rate(_, y, u=u[i]):  # the current follows at once, to a hundredth of a sample
                drive = values["K_t"] * (u - values["K_t"] * y[1]) / values["R"]
                return [y[1], (drive - values["b"] * y[1] + torque(*y)) / values["J"]]

            state = solve_ivp(rate, (0, PERIOD), state, rtol=1e-6, atol=1e-8).y[:, -1]
        speed += noise * random.standard_normal(SAMPLES)
        found.append(Experiment(1 + k, 10.0 * k, PERIOD, u, speed))
    return found


def machine(parameters):
    """A motor's file with these numbers."""
    return motor_file(parameters, SAMPLES, PERIOD)


@pytest.fixture(scope="module")
def known():
    """The machine's file, calibrated on its healthy records from numbers 5 % off."""
    random = np.random.default_rng(4)
    sheet = {n: v * float(np.exp(random.normal(0, 0.05))) for n, v in TRUE.items()}
    found = calibrate(machine(sheet), records(random, TRUE))
    return found.with_recordings(["healthy"]).machine


@pytest.mark.slow
def test_a_brake_is_friction_and_no_other_motor(known):
    """Switched on after the calibration; the file's numbers stay within its tolerances."""
    braked = {**TRUE, "b": TRUE["b"] + 1.5e-3}
    measured = records(np.random.default_rng(1), braked)
    effects = [get_effect(n) for n in TRIED]
    found = diagnose(known, measured, effects=effects, recordings=["braked"], workers=1)
    assert list(found.verdict.effects) == ["viscous_friction"]
    assert found.gap.before.rmse > 100 * NOISE
    assert found.gap.after.rmse < 1.5 * NOISE
    moved = {r.parameter: r for r in found.refit}
    assert abs(np.log(moved["K_t"].factor)) < 3 * moved["K_t"].prior_std


@pytest.mark.slow
def test_a_shaft_that_always_hangs_at_first_is_found_and_predicted(known):
    """Its phase is that of a mass at the bottom, a quarter of a turn from the file's angle 0."""

    def hanging(angle, speed):
        return -0.03 * np.sin(angle)

    measured = records(np.random.default_rng(2), TRUE, hanging, volts=3.0)
    effects = [get_effect(n) for n in TRIED]
    found = diagnose(known, measured, effects=effects, recordings=["hanging"], workers=1)
    assert list(found.verdict.effects) == ["gravity_imbalance"]
    amount = next(c for c in found.candidates if c.effect == "gravity_imbalance").parameters
    assert amount["torque"].value == pytest.approx(0.03, rel=0.1)
    assert amount["phase"].value == pytest.approx(-np.pi / 2, abs=0.2)
    assert found.gap.after.rmse < 0.3 * found.gap.before.rmse


@pytest.mark.slow
def test_the_healthy_machine_has_no_gap(known):
    """Under another excitation, by a file whose numbers are all a little off."""
    measured = records(np.random.default_rng(3), TRUE, volts=6.0)
    effects = [get_effect(n) for n in TRIED]
    assert diagnose(known, measured, effects=effects, workers=1).verdict.kind == "none"


@pytest.mark.slow
def test_a_brake_and_a_fan_are_not_one_viscous_friction():
    """A departure of that law could explain nine tenths of what only both together explain."""

    def braked(angle, speed):
        return -0.0114 * np.tanh(speed) * (1 + 0.25 * (speed / 40) ** 2)

    measured = records(np.random.default_rng(5), TRUE, braked, noise=0.02)
    effects = [get_effect(n) for n in TRIED]
    found = diagnose(machine(TRUE), measured, effects=effects, workers=1)
    assert found.verdict.acting == [["coulomb_friction"], ["quadratic_drag"]]
    assert found.gap.after.rmse < 0.03 * found.gap.before.rmse  # 0.1 of 7.8 rad/s, 1.1 before


@pytest.mark.parametrize("name", ["friction", "supply_current", "none"])
def test_a_motor_by_mujoco_is_diagnosed(name):
    """All of its cases: `python -m tests.mujoco_causes FOLDER`."""
    case = replace(CASES[name], samples=200, count=6)
    effects = [get_effect(n) for n in (*TRIED, "input_gain", "sensor_gain")]
    verdict = answer(case, effects).verdict
    assert right(case, verdict.acting, verdict.kind)
