"""A speed in another unit, or with the other sign, is said to be one."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from recorded_machines import MOTOR, ROTOR, record

from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.holdout import errors, free_run
from ldt_core.diagnosis.recorded_units import wrong_unit
from ldt_core.effects import get_effect


def told(machine, recorded, factor):
    """The note on these experiments with their speeds so many times as large."""
    shown = [replace(e, speed=factor * e.speed) for e in recorded]
    return wrong_unit(machine, shown, errors(shown, [free_run(machine, e) for e in shown]))


@pytest.mark.parametrize("machine", [MOTOR, ROTOR], ids=["motor", "rotor"])
@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (30 / math.pi, "the unit of the speed: in rpm it is"),
        (180 / math.pi, "the unit of the speed: in deg/s or rad/min it is"),
        (0.5 / math.pi, "the unit of the speed: in rps it is"),
        (1e-3, "the unit of the speed: in krad/s it is"),
        (-1.0, "the sign of the speed: the other way round it is"),
        (-30 / math.pi, "the unit and sign of the speed: in rpm and the other way round it is"),
    ],
)
def test_the_unit_is_found_though_the_file_is_not_exact(machine, factor, words):
    """Its numbers are 5 % off, as those of a data sheet."""
    off = machine.with_parameters(**{n: 1.05 * machine.parameters[n] for n in ("K_t", "R")})
    assert words in told(off, record(machine, count=3), factor)


@pytest.mark.parametrize(
    "effect", ["coulomb_friction:torque=0.05", "motor_constant:factor=0.5", "sensor_gain:factor=3"]
)
def test_a_change_of_the_machine_is_no_unit(effect):
    """Nor is what no unit explains."""
    assert told(MOTOR, record(MOTOR, effect, count=3), 1.0) == ""
    assert told(MOTOR, record(MOTOR, count=3), 1.0) == ""


@pytest.mark.slow
def test_a_diagnosis_says_so():
    """Beside its verdict, with the option that mends it."""
    shown = [replace(e, speed=30 / math.pi * e.speed) for e in record(MOTOR, count=3)]
    tried = [get_effect(n) for n in ("coulomb_friction", "inertia")]
    found = diagnose(MOTOR, shown, effects=tried, workers=1)
    assert any("ldt import --speed NAME:rpm" in note for note in found.notes)
