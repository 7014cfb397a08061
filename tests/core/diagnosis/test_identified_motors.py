"""A file that `identify` made of the healthy machine is known well enough to show a change."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from ldt_core.calibration.calibrate import calibrate
from ldt_core.calibration.identify import identify_machine
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.effects import get_effect
from tests.core.diagnosis.recorded_machines import record
from tests.motors import motor_file

pytestmark = pytest.mark.slow

#: Those that may act here, and some that look like them.
EFFECTS = [
    get_effect(name)
    for name in (
        *("motor_constant", "inertia", "armature_resistance", "viscous_friction", "sensor_gain"),
        *("coulomb_friction", "constant_load", "quadratic_drag", "sensor_lag"),
    )
]
TRUE = {"J": 2e-4, "K_t": 0.05, "R": 1.5, "L": 5e-4, "b": 1e-4}
SAMPLES, PERIOD, NOISE = 800, 0.005, 0.5
runs = functools.partial(record, count=6, samples=SAMPLES, hold=100, noise=NOISE)


@pytest.fixture(scope="module")
def healthy():
    """Its motor has another resistance and no friction, by convention."""
    records = runs(motor_file(TRUE, SAMPLES, PERIOD), seed=3)
    return identify_machine(records, "m", limits=(-24, 24)).machine


def test_how_well_it_is_known_covers_the_true_motor(healthy):
    """Gain and time constant of the true one, within four deviations; L hardly shows."""
    whole = TRUE["K_t"] ** 2 + TRUE["R"] * TRUE["b"]
    gain, lag = TRUE["K_t"] / whole, TRUE["R"] * TRUE["J"] / whole
    for name, true in (("K_t", 1 / gain), ("J", lag / gain**2)):
        told = healthy.calibration["free"][name]
        assert 0 < told["std"] < 0.01 * told["value"]
        assert told["value"] == pytest.approx(true, abs=4 * told["std"] + 0.005 * true)


@pytest.mark.parametrize(
    ("changed", "names"),
    [
        ({"K_t": 0.045}, {"motor_constant"}),
        ({"J": 2.4e-4}, {"inertia", "armature_resistance"}),
        ({"R": 1.65}, {"armature_resistance", "inertia"}),
    ],
)
def test_a_number_that_changed_is_named(healthy, changed, names):
    """With the usual tolerance of a data sheet, no effect was needed to explain 9 rad/s."""
    records = runs(motor_file({**TRUE, **changed}, SAMPLES, PERIOD), seed=7)
    verdict = diagnose(healthy, records, effects=EFFECTS, workers=1).verdict
    assert verdict.kind in ("effect", "ambiguous")
    assert names & set(verdict.acting[0])


def test_the_same_machine_has_no_gap(healthy):
    """In other experiments."""
    records = runs(motor_file(TRUE, SAMPLES, PERIOD), seed=8)
    assert diagnose(healthy, records, effects=EFFECTS, workers=1).verdict.kind == "none"


@pytest.mark.parametrize("inductance", [5e-4, 1e-5, 0.0])
@pytest.mark.parametrize("noise", [0.1, 0.02])
def test_a_better_sensor_makes_nothing_worse(noise, inductance):
    """It shows how small L is: a hundredth of a sample's time was taken, and seen to be wrong."""
    motor = motor_file({**TRUE, "L": inductance}, SAMPLES, PERIOD)
    found = identify_machine(runs(motor, seed=3, noise=noise), "m", limits=(-24, 24))
    assert found.errors["fit"].rmse == pytest.approx(noise, rel=0.1)
    deviations = found.posterior.deviations
    assert max(deviations["J"], deviations["K_t"]) < 1e-3


FRICTION = "coulomb_friction:torque=0.004"
few = functools.partial(runs, count=4, samples=500)


@pytest.fixture(scope="module")
def with_friction():
    """Files of a motor whose dry friction neither of them has: identified, and calibrated."""
    records = few(motor_file(TRUE, SAMPLES, PERIOD), FRICTION, seed=3)
    sheet = motor_file({**TRUE, "K_t": 0.053, "R": 1.4, "J": 2.3e-4}, SAMPLES, PERIOD)
    identified = identify_machine(records, "m", limits=(-24, 24)).machine
    return {
        "identified": identified,
        "calibrated": calibrate(sheet, records).with_recordings(["healthy"]).machine,
    }


@pytest.mark.parametrize("file", ["identified", "calibrated"])
@pytest.mark.parametrize(
    ("changed", "names"),
    [
        ({"K_t": 0.045}, {"motor_constant"}),
        ({"J": 2.4e-4}, {"inertia", "armature_resistance"}),
    ],
)
def test_a_number_that_changed_is_named_beside_what_the_file_lacks(
    with_friction, file, changed, names
):
    """The friction alone was named, at 0.91, with the usual tolerance for a number 10 % off."""
    records = few(motor_file({**TRUE, **changed}, SAMPLES, PERIOD), FRICTION, seed=7)
    found = diagnose(with_friction[file], records, effects=EFFECTS, workers=1)
    acting = found.verdict.acting
    assert any("coulomb_friction" in group for group in acting)
    assert any(names & set(group) for group in acting)


def test_a_file_knows_how_far_its_numbers_imitate_what_it_lacks(with_friction):
    """Three deviations, of a posterior that was as narrow as the noise, or none."""
    for name, machine in with_friction.items():
        told = machine.calibration["posterior"]
        root = dict(zip(told["parameters"], np.linalg.norm(told["root"], axis=1), strict=True))
        stated = {n: s / machine.parameters[n] for n, s in machine.deviations.items()}
        assert (name == "calibrated") == bool(stated)
        assert all(s >= 0.99 * machine.model.tolerances[n] for n, s in stated.items())
        assert 0.01 < root["K_t"] < 0.2, name
