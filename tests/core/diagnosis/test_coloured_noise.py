"""A motor whose speed sensor has a memory: its noise is stronger at low frequencies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded_machines import MOTOR, record
from scipy.signal import lfilter

from ldt_core.calibration.calibrate import calibrate
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.nominal_prior import known_colour
from ldt_core.effects import get_effect

NOISE, MEMORY = 0.3, 0.5  # rad/s, correlation of neighbouring samples
TRIED = [get_effect(n) for n in ("coulomb_friction", "constant_load", "sensor_gain")]


def noisy(experiments, seed, memory):
    """The experiments with such noise on the speed."""
    random, found = np.random.default_rng(seed), []
    for e in experiments:
        white = NOISE * np.sqrt(1 - memory**2) * random.standard_normal(len(e) + 100)
        noise = lfilter([1.0], [1.0, -memory], white)[100:]
        found.append(replace(e, speed=e.speed + noise))
    return found


def recorded(*effects, seed, memory=MEMORY):
    clean = record(MOTOR, *effects, count=6, samples=500, noise=0.0, seed=seed)
    return noisy(clean, seed, memory)


@pytest.fixture(scope="module")
def calibrated():
    """By records of the healthy machine."""
    return calibrate(MOTOR, recorded(seed=1)).with_recordings(["healthy"]).machine


def test_a_healthy_machine_has_no_gap(calibrated):
    """What its calibration has left as well is no gap, and the noise is told as it is."""
    found = diagnose(calibrated, recorded(seed=2), effects=TRIED, workers=1)
    assert found.verdict.kind == "none"
    assert found.gap.noise_std == pytest.approx(NOISE, rel=0.1)


def test_a_small_cause_is_not_missed(calibrated):
    """One that moves the speed by half as much as the noise does."""
    friction = get_effect("coulomb_friction"), {"torque": 5e-4}
    seen = recorded(friction, seed=3)
    moved = [e.speed - h.speed for e, h in zip(seen, recorded(seed=3), strict=True)]
    assert np.std(np.concatenate(moved)) < 0.6 * NOISE
    found = diagnose(calibrated, seen, effects=TRIED, workers=1)
    assert list(found.verdict.effects) == ["coulomb_friction"]


def test_only_a_sound_calibration_tells_the_colour(calibrated):
    """Not one of the records that are diagnosed, nor of values that were edited since."""
    assert known_colour(calibrated, ["other"])
    assert not known_colour(calibrated, ["healthy"])
    assert not known_colour(calibrated.with_parameters(J=2 * calibrated.parameters["J"]))
    record = {**calibrated.calibration, "lacking": ["coulomb_friction"]}
    assert not known_colour(replace(calibrated, calibration=record))
    white = calibrate(MOTOR, recorded(seed=1, memory=0.0)).machine
    assert not known_colour(white)
