"""Recordings that no cause explains: without voltage, in wrong units. A diagnosis ends, unknown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded_machines import PERIOD, ROTOR, record

from ldt_core.diagnosis import set_fits
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.next_experiment import _designs
from ldt_core.effects import get_effect, parse_effect
from ldt_core.physics.base import FreeRun, Work
from ldt_core.physics.motor_driven import ROUND_PRICE, USUAL_ROUNDS
from ldt_core.physics.side_by_side import ALONE
from tests.motors import motor_file

MOTOR = motor_file({"J": 2e-4, "K_t": 0.038, "R": 0.6, "L": 1e-4, "b": 2e-4}, 300, PERIOD)
#: Among them those that turn a shaft, bend, or need others to show.
TRIED = (
    *("cogging_torque", "brush_drop", "winding_heating", "asymmetric_friction"),
    *("open_circuit", "constant_load", "inertia"),
)
MOST_WORK = 3_000_000  # integration steps: a second
#: Of that, what fits that have begun when it is done may take beyond.
BEYOND = 4
UNITS = {
    "no voltage": (0.0, 1.0),
    "voltage in kV": (1e-3, 1.0),
    "speed in mrad/s": (1.0, 1e3),
}


@pytest.mark.parametrize("units", UNITS)
@pytest.mark.parametrize("machine", [ROTOR, MOTOR], ids=["rotor", "motor"])
@pytest.mark.slow
def test_a_gap_that_nothing_explains_ends_at_the_limit_of_work(machine, units, monkeypatch):
    """It took more than fifteen minutes: steps were halved down to nothing, and not counted."""
    monkeypatch.setattr(set_fits, "MOST_WORK", MOST_WORK)
    searches, begin = [], set_fits.SetFits.__init__

    def kept(self, *about, **how):
        searches.append(self)
        begin(self, *about, **how)

    monkeypatch.setattr(set_fits.SetFits, "__init__", kept)
    volt, speed = UNITS[units]
    given = [
        replace(e, voltage=volt * e.voltage, speed=speed * e.speed)
        for e in record(machine, count=4, samples=300)
    ]
    found = diagnose(machine, given, effects=[get_effect(n) for n in TRIED], workers=1)
    assert found.verdict.kind == "unknown"
    assert any("at most by the machine file" in note for note in found.notes)
    assert searches[0].residuals.work.steps < BEYOND * MOST_WORK


def test_without_a_voltage_a_step_is_solved_as_soon_as_with_one():
    """What counts as solved goes by the motion itself, which the voltage need not have made."""
    use = [parse_effect("brush_drop:voltage=0.5"), parse_effect("gravity_imbalance:torque=0.05")]
    first, volts = np.zeros(len(MOTOR.model.states)), np.zeros(300)
    first[0] = 1.0
    work = Work()
    run = FreeRun(MOTOR.parameters, volts, PERIOD, first, use, work=work)
    ((_, states),) = MOTOR.model.simulate_all([run], 5e-3, 0.5e-3)
    assert np.abs(states[:, 1]).max() > 1.0
    assert work.steps < (ALONE + 4 * USUAL_ROUNDS * ROUND_PRICE) * volts.size


@pytest.mark.parametrize("factor", [1.0, 1e3])
def test_what_would_tell_causes_apart_moves_the_machine(factor):
    """A design at rest, of a file in wrong units, was said to tell them apart by ∞ deviations."""
    values = {**ROTOR.parameters, "J": factor * ROTOR.parameters["J"]}
    slow = replace(ROTOR, parameters=values)
    designs = _designs(FreeRunResiduals(slow, record(ROTOR)[:1], (0.1, 0.1)), 0)
    assert len(designs) == (6 if factor == 1.0 else 5)
    assert all(volts.any() for _, volts in designs)
