"""Claims about diagnoses where a sensor is at fault: it is never taken for the machine."""

from __future__ import annotations

import faulty_sensors as sensors
import pytest
from faulty_sensors import FAULTS, SHORT, broken, made, shown

from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.effects import get_effect

FEW = [get_effect(n) for n in ("sensor_bias", "viscous_friction", "motor_constant", "unbalance")]


@pytest.mark.parametrize("fails", [sensors.sticks, sensors.saturates, sensors.steps])
def test_a_faulty_sensor_from_the_first_experiment_on_is_said_to_be_one(fails):
    """The verdict is unknown, names the fault, and blames no effect of the machine."""
    found = diagnose(SHORT, broken(made(4), fails, 1, 4), effects=FEW, workers=1)
    assert found.verdict.kind == "unknown"
    assert found.verdict.effects == []
    assert found.verdict.sentence.startswith("Sensor fault: in experiment 1 ")
    assert FAULTS[fails] in found.verdict.sentence
    assert {c.rejected_because for c in found.candidates} == {"not tried: the sensor is faulty"}


def test_a_sensor_that_fails_later_does_not_hide_what_the_machine_has():
    """The experiments before it are diagnosed, and it is said that there is more."""
    experiments = made(8, effects=["viscous_friction:b=0.03"])
    found = diagnose(SHORT, broken(experiments, sensors.stuck, 6, 8), effects=FEW, workers=1)
    assert found.verdict.effects == ["viscous_friction"]
    assert "before a sensor fault: in experiment 6 " in found.verdict.sentence
    assert {*found.experiments["fit"], *found.experiments["held_out"]} == {1, 2, 3, 4, 5}


def test_a_sensor_off_by_a_constant_is_told_from_a_machine_that_has_changed():
    """It is plausible, and comes out as the sensor's effect."""
    offset = [shown(e, e.speed + 8.0) for e in made(6, effects=[])]
    found = diagnose(SHORT, offset, effects=FEW, workers=1)
    assert found.verdict.effects == ["sensor_bias"]
