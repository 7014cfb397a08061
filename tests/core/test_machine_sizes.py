"""Effects are as large as the machine that they are looked for on."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.diagnosis.candidate import Candidate
from ldt_core.effects import EFFECTS
from ldt_core.machine.machine_file import load_machine
from ldt_core.physics.machine_sizes import in_own_sizes, machine_scales, most_of


@given(st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_a_machine_that_is_larger_has_larger_effects(torque, speed):
    """Sizes follow from the machine's own units: those of drag from torque and speed."""
    values = {"J": 1.0, "K_t": 16.0 / speed, "R": 16.0 * 16.0 / (torque * speed), "b": 0.0}
    found = machine_scales(values, 16.0)
    assert all(math.isfinite(v) and v > 0 for v in found.values())
    for unit, power in (("N m s", 1), ("N m s^2", 2), ("N m s^3", 3)):
        assert found[unit] == pytest.approx(found["N m"] / found["rad/s"] ** power)
    assert found["N m"] == 1.0 or found["N m"] == pytest.approx(torque / 4.8)
    assert found["rad/s"] == 1.0 or found["rad/s"] == pytest.approx(speed / 53.3, rel=1e-3)


def test_what_is_no_motor_keeps_the_librarys_sizes():
    """A pendulum has no torque constant to take a torque from."""
    assert machine_scales({"m": 1.0, "l": 0.5}, 12.0) == {}


def test_the_worked_case_has_the_librarys_sizes():
    """Also where its parameters are known only about."""
    rotor = load_machine("rotor").parameters
    for off in (0.8, 1.0, 1.25):
        sizes = machine_scales({**rotor, "K_t": off * rotor["K_t"]}, 16.0)
        assert set(sizes.values()) == {1.0}


@given(st.sampled_from(EFFECTS.names()), st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_an_effect_accepts_its_values_in_every_size(name, torque, speed):
    """Bounds hold, and what is absent stays absent."""
    effect = EFFECTS.get(name)
    values = {"J": 1.0, "K_t": 16.0 / speed, "R": 16.0 * 16.0 / (torque * speed), "b": 0.0}
    sizes = machine_scales(values, 16.0)
    absent = in_own_sizes(effect, {}, sizes)
    first = effect.parameters[0].name
    assert absent[first] == effect.neutral[first]
    found = in_own_sizes(effect, effect.typical, sizes)
    assert effect.check(found) == found


def test_a_coupling_is_sought_where_it_shows_on_this_machine():
    """A search of absolute stiffnesses ended above those at which a small motor's shaft swings."""
    effect = EFFECTS.get("torsional_compliance")
    values = {"J": 3e-4, "K_t": 0.05, "R": 1.5, "b": 1e-4}
    candidate = Candidate(effect, most_of(values, 12.0), machine_scales(values, 12.0))
    low, high = candidate.bounds
    for hertz in (1.0, 2.0, 5.0, 10.0):
        z = candidate.coordinate(1, values["J"] / 4 * (2 * math.pi * hertz) ** 2)
        assert low[1] < z < high[1]
    stiffness = [candidate.given(z)["stiffness"] for z in candidate.starts()]
    swings = np.sqrt(np.array(stiffness) / (values["J"] / 4)) / (2 * math.pi)
    assert swings.min() < 2.0
    assert swings.max() > 8.0
