"""Claims about departures of a machine's laws from those of the library."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from recorded_machines import MOTOR, candidates, record

from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.effect_fit import fit
from ldt_core.diagnosis.error_band import ErrorBand
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.law_departure import LawDepartures
from ldt_core.effects import get_effect
from ldt_core.physics.effect import Effect
from ldt_core.physics.parameter import Parameter

pytestmark = pytest.mark.slow

VOLTS = (-12.0, 12.0)


def _rising(t, theta, omega, current, voltage, p):
    return -p[0] * math.tanh(omega / 0.5) * (1.0 + p[1] * math.fabs(omega) / 60.0)


def friction_that_rises(by: float) -> tuple[Effect, dict[str, float]]:
    """Dry friction that grows with the speed, by this part of itself at 60 rad/s."""
    parameters = (
        Parameter("torque", "N m", 0.0, default=0.0, description="at rest"),
        Parameter("by", "", 0.0, default=0.0, description="at 60 rad/s"),
    )
    effect = Effect("rising_friction", "dry friction", "T", parameters, torque=_rising)
    return effect, {"torque": 0.05, "by": by}


def left_and_taken(*acting, name="coulomb_friction", **recorded):
    """Power beyond noise that one effect leaves, and what departures of its law take of it."""
    experiments = record(MOTOR, *acting, volts=VOLTS, count=4, **recorded)
    residuals = FreeRunResiduals(MOTOR, experiments)
    (c,) = candidates(MOTOR, [name])
    found = fit(residuals, [c], [c.coordinates(c.typical)])
    departures = LawDepartures(residuals, residuals.of())
    return ErrorBand(residuals).speed_excess(found.residual), departures.taken(found)


def test_a_law_that_is_a_little_off_is_no_further_effect():
    """Friction that grows by a third with the speed is nearly all a departure of Coulomb's."""
    left, taken = left_and_taken(friction_that_rises(0.3))
    assert left > 1000
    assert taken > 0.95 * left


def _wound(t, theta, omega, current, voltage, p):
    return -p[0] * (1.0 + p[1] * math.tanh(theta / 100.0))


def test_a_load_that_depends_on_the_angle_departs():
    """Nearly all that the plain law leaves of it."""
    parameters = (
        Parameter("torque", "N m", 0.0, default=0.0, description="at angle 0"),
        Parameter("by", "", -1.0, default=0.0, description="of it, far away"),
    )
    load = Effect("wound_load", "a winch", "T", parameters, torque=_wound)
    left, taken = left_and_taken((load, {"torque": 0.05, "by": -0.3}), name="constant_load")
    assert left > 1000
    assert taken > 0.9 * left


def test_an_exact_law_departs_in_nothing():
    """The freedom of departures costs more than it gains."""
    assert left_and_taken("coulomb_friction:torque=0.05")[1] == 0.0


def test_another_effect_is_no_departure():
    """Gravity turns with the shaft, whatever the friction does."""
    left, taken = left_and_taken("coulomb_friction:torque=0.05", "gravity_imbalance:torque=0.03")
    assert taken < 0.5 * left


def test_a_sensors_departure_is_no_push_of_the_motor():
    """A gain that bends by a few per cent is the gain's own."""

    def bent(speed, period, factor):
        return speed * (1.0 + (factor - 1.0) * (1.0 + 0.2 * np.abs(speed) / 60.0))

    gain = Parameter("factor", "", 0.0, default=1.0, description="of the speed", open_low=True)
    effect = Effect("bent_gain", "sensor", "w", (gain,), on_measurement=bent)
    left, taken = left_and_taken((effect, {"factor": 1.2}), name="sensor_gain")
    assert taken > 0.95 * left > 500


@pytest.mark.parametrize("by", [0.0, 0.3, 0.5])
def test_a_departure_is_given_no_name(by):
    """The friction is named, and neither drag nor heating that would mend its law."""
    experiments = record(MOTOR, friction_that_rises(by), volts=VOLTS, count=6)
    names = ("coulomb_friction", "winding_heating", "quadratic_drag", "inertia", "sensor_gain")
    found = diagnose(MOTOR, experiments, effects=[get_effect(n) for n in names], workers=1)
    assert found.verdict.acting == [["coulomb_friction"]]


@pytest.mark.parametrize(
    ("lacking", "kind"), [(["stribeck_friction"], "effect"), ([], "unknown")], ids=["some", "none"]
)
def test_laws_that_the_file_knows_of_are_no_more_exact(lacking, kind):
    """What its friction leaves hides no delay, unless its calibration has found that it fits."""
    known = MOTOR.with_effects([(get_effect("coulomb_friction"), {"torque": 0.05})])
    known = replace(known, calibration={"lacking": lacking})
    acting = friction_that_rises(0.1), "input_delay:delay=0.01"
    tried = [known.effect(n) for n in ("input_delay", "coulomb_friction", "constant_load")]
    found = diagnose(known, record(MOTOR, *acting, volts=VOLTS, count=5), effects=tried, workers=1)
    assert found.verdict.kind == kind
    assert kind == "unknown" or "input_delay" in found.verdict.effects
