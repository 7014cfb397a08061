"""A turntable of a rad/s, by a plant that truly sticks: no law is written for one speed."""

from __future__ import annotations

import numpy as np

from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.machine.machine_file import Machine, load_machine

#: Inertia [kg m^2], constant [N m/A], resistance [Ohm], viscous [N m s] and dry friction [N m].
J, K_T, R, B, DRY = 40.0, 20.0, 2.0, 0.5, 15.0
PERIOD, STEPS, NOISE = 0.01, 20, 0.002  # s, integration steps a sample, rad/s


def turntable(path) -> Machine:
    """Its machine file, which knows no dry friction."""
    path.write_text(f"""
name: turntable
physics: dc_motor
parameters: {{J: {J}, K_t: {K_T}, R: {R}, L: 0.002, b: {B}}}
limits: {{voltage: [-24, 24]}}
experiment: {{duration: 12, sample_period: {PERIOD}}}
""")
    return load_machine(path)


def recorded(count: int) -> list[Experiment]:
    """Steps of the voltage; a shaft at rest moves again where the motor beats the friction."""
    random = np.random.default_rng(3)
    volts = np.repeat(random.uniform(-8, 8, (count, 12)), 100, axis=1)
    speed, seen = np.zeros(count), np.zeros_like(volts)
    for sample in range(volts.shape[1]):
        seen[:, sample] = speed
        for _ in range(STEPS):
            pull = K_T * (volts[:, sample] - K_T * speed) / R - B * speed
            held = (speed == 0) & (np.abs(pull) <= DRY)
            way = np.where(speed == 0, np.sign(pull), np.sign(speed))
            after = speed + PERIOD / STEPS * (pull - DRY * way) / J
            after[speed * after < 0] = 0.0
            speed = np.where(held, 0.0, after)
    seen += NOISE * random.standard_normal(seen.shape)
    rows = enumerate(zip(volts, seen, strict=True), 1)
    return [Experiment(i, 20.0 * i, PERIOD, v, s) for i, (v, s) in rows]


def test_a_turntable_s_dry_friction_is_found_down_to_the_noise(tmp_path):
    """Smoothed over 0.02 rad/s, its law left twice the noise and took a part for Stribeck's."""
    verdict = diagnose(
        turntable(tmp_path / "turntable.yaml"), recorded(1), seed=0, workers=1
    ).verdict
    assert verdict.acting == [["coulomb_friction"]]
    assert verdict.confidence > 0.9
    assert "15.0" in verdict.sentence
