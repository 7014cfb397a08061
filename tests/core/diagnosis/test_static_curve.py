"""A set of effects is no cause where one free curve follows the machine far better."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_machines import MOTOR, record

from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.holdout import free_run
from ldt_core.diagnosis.static_curve import CURVES, FreeCurves, StaticCurve
from ldt_core.effects import get_effect

NOISE = 0.5  # rad/s
SATURATING_SENSOR = 2e-4  # s/rad


def recorded(*effects, supply=lambda volts: volts, sensor=lambda speed: speed):
    """Experiments of a motor whose terminals and sensor see other than what is recorded."""
    random, found = np.random.default_rng(5), []
    for e in record(MOTOR, *effects, count=5, noise=0.0):
        if not effects:
            supplied = dataclasses.replace(e, voltage=supply(np.asarray(e.voltage)))
            e = dataclasses.replace(e, speed=sensor(free_run(MOTOR, supplied)))
        noise = NOISE * random.standard_normal(len(e))
        found.append(dataclasses.replace(e, speed=e.speed + noise))
    return found


MACHINES = {
    "voltage": recorded(supply=lambda u: u * (1 - 0.02 * np.abs(u))),
    "current": recorded("brush_drop:voltage=1"),
    "speed": recorded("quadratic_drag:c=1e-5"),
    "sensor": recorded(sensor=lambda w: w - SATURATING_SENSOR * w * np.abs(w)),
}


@pytest.mark.parametrize("of", CURVES)
def test_a_curve_follows_a_law_of_its_quantity_alone(of):
    """Down to the noise where the machine has such a law; curves of other quantities do not."""
    fitted, held = MACHINES[of][:4], MACHINES[of][4:]
    missing = [[e.speed - free_run(MOTOR, e) for e in part] for part in (fitted, held)]
    left = {name: StaticCurve(MOTOR, name, fitted, held).left(*missing) ** 0.5 for name in CURVES}
    assert left[of] < 1.5 * NOISE
    assert min(error for name, error in left.items() if name != of) > 1.5 * left[of]


def verdict(experiments, *names):
    """Of a diagnosis by a part of the library."""
    effects = [get_effect(name) for name in names]
    return diagnose(MOTOR, experiments, effects=effects, workers=1).verdict


def test_a_law_that_a_set_only_imitates_is_unknown():
    """A sensor that saturates: an inertia and a drag imitate it, and leave little."""
    found = verdict(MACHINES["sensor"], "inertia", "quadratic_drag")
    assert (found.kind, found.effects) == ("unknown", [])
    assert "a sensor that is off by another amount" in found.sentence


def test_a_law_that_is_only_off_keeps_its_name():
    """A voltage that saturates softly: the curve only has its law more exactly."""
    soft = recorded(supply=lambda u: 6.0 * np.tanh(u / 6.0))
    assert verdict(soft, "voltage_saturation", "quadratic_drag").effects == ["voltage_saturation"]


@pytest.mark.parametrize(
    ("beside", "refuted"),
    [
        (0.003824, False),  # a winding whose resistance falls with the current, truly
        (0.0040, True),  # less than half of what the set leaves: the curve is no part of its law
    ],
)
def test_a_law_that_is_off_is_told_by_the_curve_beside_it(monkeypatch, beside, refuted):
    """By what a set and curves left of a machine with this law [rad^2/s^2]."""
    held = MACHINES["current"][4:]
    after = [e.speed - 0.004207**0.5 for e in held]
    curves = FreeCurves(MOTOR, MACHINES["current"][:4], held, [a - 0.06787**0.5 for a in after])
    left = {"voltage": [0.06446], "current": [0.003628, beside], "speed": [1.0], "sensor": [1.0]}
    monkeypatch.setattr(StaticCurve, "left", lambda self, *errors: left[self.of].pop(0))
    found = curves.instead(SimpleNamespace(use=()), after, 0.00354**0.5)
    assert bool(found) is refuted
