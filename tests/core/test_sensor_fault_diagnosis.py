"""Claims about diagnoses where a sensor is at fault: it is never taken for the machine."""

from __future__ import annotations

from dataclasses import replace

import faulty_sensors as sensors
import numpy as np
import pytest
from faulty_sensors import FAULTS, SHORT, broken, made, shown

from ldt_core.base.experiment import Experiment
from ldt_core.cli.diagnose import _print as told_on_terminal
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.effects import get_effect
from ldt_core.machine.sensor_check import doubt, fault
from ldt_core.views.diagnosis_page.diagnosis_sections import answer

FEW = [get_effect(n) for n in ("sensor_bias", "viscous_friction", "motor_constant", "unbalance")]


@pytest.mark.parametrize("fails", [sensors.sticks, sensors.saturates, sensors.steps])
def test_a_faulty_sensor_from_the_first_experiment_on_is_said_to_be_one(fails, tmp_path, capsys):
    """The verdict is unknown, names the fault, and blames no effect of the machine."""
    found = diagnose(SHORT, broken(made(4), fails, 1, 4), effects=FEW, workers=1)
    assert found.verdict.kind == "unknown"
    assert found.verdict.effects == []
    assert found.verdict.sentence.startswith("Sensor fault: in experiment 1 ")
    assert FAULTS[fails] in found.verdict.sentence
    assert {c.rejected_because for c in found.candidates} == {"not tried: the sensor is faulty"}
    told_on_terminal(found, tmp_path)
    told = capsys.readouterr().out
    assert "Confidence" not in told  # of verdicts on machines it is: "9%", beside a plain fault
    assert "what was tried" not in told
    assert answer(found, tmp_path).aside == ""


def test_a_sensor_that_saturates_at_both_ends_is_one_that_saturates():
    """Each end was taken for what this sensor usually does, and hid the other one."""
    volts = np.repeat([11.0, 9.0, -11.0, -9.0, 3.0], 100)
    speed = np.zeros(500)
    for k in range(1, 500):
        speed[k] = speed[k - 1] + 0.026 * (19.2 * volts[k - 1] - speed[k - 1])
    seen = np.clip(speed + np.random.default_rng(0).normal(0, 0.1, 500), -90, 90)
    assert "a sensor that sticks or saturates" in fault(SHORT, Experiment(1, 1, 0.01, volts, seen))


def test_a_speed_that_a_reversed_voltage_does_not_move_is_no_blocked_rotor():
    """Where motion hid the sensor's noise, 84 rad/s for 10 s were a note: "sensor or machine?"."""
    before = made(3, effects=[], noise=0.0)
    stuck = shown(before[-1], 0 * before[-1].speed + 84.2)
    reversing = replace(stuck, voltage=np.where(np.arange(len(stuck)) < len(stuck) / 2, 9.0, -9.0))
    assert "a sensor that sticks" in fault(SHORT, reversing, before)
    assert fault(SHORT, replace(reversing, speed=0 * stuck.speed), before) == ""


def test_a_shaft_that_friction_holds_is_no_dead_sensor():
    """Up to a quarter of the highest voltage, where no sensor's noise has been seen before."""
    volts = np.repeat([0.0, 0.1, 0.2], 100) * max(SHORT.voltage_limits)
    still = Experiment(1, 0.0, 0.01, volts, 0 * volts)
    assert fault(SHORT, still) == ""
    assert doubt(SHORT, still) == ""
    driven = replace(still, voltage=2 * volts)
    assert "a sensor that is dead, or a blocked rotor" in fault(SHORT, driven)
    assert "a blocked rotor" in fault(SHORT, still, made(2, effects=[]))


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
