"""A motor that is fast against the sample period, and a speed sensor with heavy-tailed noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded_machines import record

from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.effects import get_effect
from tests.motors import motor_file

FAST = motor_file({"J": 2e-5, "K_t": 0.05, "R": 0.8, "L": 1e-4, "b": 1e-5}, 500, 0.01)  # 6 ms
FREEDOM = 3  # degrees of Student's law: its deviation is 1.5 times what its median tells
TRIED = [get_effect(n) for n in ("coulomb_friction", "viscous_friction", "sensor_lag", "inertia")]


def answer(*effects, seed):
    """The diagnosis, and the deviation of the noise [rad/s]."""
    random, seen, drawn = np.random.default_rng(seed), [], []
    for e in record(FAST, *effects, count=6, noise=0.0, seed=seed):
        noise = random.standard_t(FREEDOM, len(e)) / np.sqrt(FREEDOM)
        seen.append(replace(e, speed=e.speed + noise))
        drawn.append(noise)
    return diagnose(FAST, seen, effects=TRIED, workers=1), np.std(drawn)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_healthy_machine_has_no_gap(seed):
    """All three were `unknown`, at up to 0.75: such a motor follows every frequency."""
    found, noise = answer(seed=seed)
    assert found.verdict.kind == "none"
    assert found.gap.noise_std == pytest.approx(noise, rel=0.05)


def test_a_small_cause_is_not_taken_for_noise():
    """It moves the speed by less than the noise does."""
    found, _ = answer((get_effect("coulomb_friction"), {"torque": 5e-4}), seed=1)
    assert "coulomb_friction" in found.verdict.effects
