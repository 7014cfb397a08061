"""What limits a motor's torque: the laws, and their names where a controller asks for more."""

from __future__ import annotations

import numpy as np
import pytest
from recorded_machines import MOTOR, PERIOD, uses

from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.effects import get_effect
from tests.motors import motor_file

TRUE = {"J": 2e-4, "K_t": 0.05, "R": 1.5, "L": 5e-4, "b": 1e-4}
SAMPLES, STEP, NOISE = 600, 0.005, 1.0  # of an experiment, s, rad/s
FINE = 50  # steps of an engine of its own in a sample
LIMIT = 4.0  # A
#: What limits something, or changes what a current does.
TRIED = [
    get_effect(name)
    for name in (
        *("current_limit", "magnetic_saturation", "voltage_saturation", "brush_drop", "inertia"),
        *("motor_constant", "armature_resistance", "source_resistance", "coulomb_friction"),
    )
]


def test_the_current_stays_at_its_limit_and_the_torque_with_it():
    """Through a reversal, which would take nine times as much."""
    volts = np.repeat([12.0, -12.0, 0.3], 100)
    values, use = MOTOR.parameters, uses(["current_limit:limit=2"])
    states = MOTOR.model.simulate(values, volts, PERIOD, MOTOR.model.initial_state(values, 0), use)
    free = MOTOR.model.simulate(values, volts, PERIOD, MOTOR.model.initial_state(values, 0))
    assert np.abs(free[:, 2]).max() > 8
    assert np.abs(states[:, 2]).max() == pytest.approx(2, rel=1e-3)
    assert np.abs(np.diff(states[5:90, 1]) / PERIOD).max() <= 2 * values["K_t"] / values["J"]


def test_a_weakened_field_turns_and_brakes_less():
    """By K_t / (1 + (i / i_h)^2) in both equations of the motor, in steady running too."""
    values, use = MOTOR.parameters, uses(["magnetic_saturation:current=4"])
    start = MOTOR.model.initial_state(values, 0)
    states = MOTOR.model.simulate(values, np.full(3000, 10.0), PERIOD, start, use)
    (_, speed, current) = states[-1, :3]
    constant = values["K_t"] / (1 + (current / 4) ** 2)
    assert constant * current == pytest.approx(values["b"] * speed, rel=1e-3)
    assert values["R"] * current + constant * speed == pytest.approx(10, rel=1e-4)


def closed_loop(seed: int, count: int, limit: float, half: float) -> list[Experiment]:
    """Experiments under a PI controller of the speed.

    The drive cuts the current at a limit [A], or the constant has halved at a current [A].
    """
    random = np.random.default_rng(seed)
    found = []
    for number in range(1, count + 1):
        wanted = np.repeat(random.uniform(-150, 150, 6), SAMPLES // 6)
        speed = current = total = 0.0
        u, w = np.empty(SAMPLES), np.empty(SAMPLES)
        h = STEP / FINE
        for k in range(SAMPLES):
            w[k] = speed + NOISE * random.standard_normal()
            error = wanted[k] - w[k]
            u[k] = np.clip(0.15 * error + total, -24, 24)
            total += 1.0 * error * STEP if abs(u[k]) < 24 else 0.0
            for _ in range(FINE):
                constant = TRUE["K_t"] / (1 + (current / half) ** 2)
                back, most = constant * speed, TRUE["R"] * limit
                terminals = min(max(u[k], back - most), back + most)
                rise = (terminals - back - TRUE["R"] * current) / TRUE["L"]
                speed += h * (constant * current - TRUE["b"] * speed) / TRUE["J"]
                current += h * rise
        found.append(Experiment(number, 10.0 * number, STEP, u, w))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "parameter", "size", "laws"),
    [
        ("current_limit", "limit", LIMIT, (LIMIT, np.inf)),
        ("magnetic_saturation", "current", 10.0, (np.inf, 10.0)),
    ],
)
def test_a_limited_torque_is_no_limited_voltage(name, parameter, size, laws):
    """That was the name of both, at 0.83 to 0.92, and left eleven times the noise."""
    records = closed_loop(1, 4, *laws)
    found = diagnose(motor_file(TRUE, SAMPLES, STEP), records, effects=TRIED, workers=1)
    assert found.verdict.acting == [[name]]
    amounts = next(c for c in found.candidates if c.effect == name).parameters
    assert amounts[parameter].value == pytest.approx(size, rel=0.01)
    assert found.gap.after.rmse < 1.1 * NOISE
