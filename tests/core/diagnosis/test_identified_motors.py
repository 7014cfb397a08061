"""A file that `identify` made of the healthy machine is known well enough to show a change."""

from __future__ import annotations

import functools

import pytest

from ldt_core.calibration.identify import identify_machine
from ldt_core.diagnosis.diagnose import diagnose
from tests.core.diagnosis.recorded_machines import record
from tests.motors import motor_file

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
    verdict = diagnose(healthy, records).verdict
    assert verdict.kind in ("effect", "ambiguous")
    assert names & set(verdict.acting[0])


def test_the_same_machine_has_no_gap(healthy):
    """In other experiments."""
    records = runs(motor_file(TRUE, SAMPLES, PERIOD), seed=8)
    assert diagnose(healthy, records).verdict.kind == "none"
