"""Claims about candidates: coordinates, bounds, starts, and sizes that fit the machine."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recorded_machines import MOTOR, ROTOR, candidates

from ldt_core.diagnosis.candidate import MOST_STARTS
from ldt_core.effects import EFFECTS
from ldt_core.physics.machine_sizes import is_limit
from ldt_core.physics.parameter import logarithmic

NAMES = EFFECTS.names()
MOST = max(len(EFFECTS.get(n).parameters) for n in NAMES)
MACHINES = {"rotor": (ROTOR, 16.0), "motor": (MOTOR, 12.0), "tiny": (MOTOR, 0.5)}


def candidate(name, machine="rotor"):
    known, most = MACHINES[machine]
    return candidates(known, [name], most)[0]


def inside(c, parts):
    """Coordinates at these parts of the way between the bounds, at most 5 from neutral."""
    low, high = (np.clip(b, -5.0, 5.0) for b in c.bounds)
    return low + np.array([part % 1.0 for part in parts[: len(c)]]) * (high - low)


@given(
    st.sampled_from(NAMES),
    st.sampled_from(sorted(MACHINES)),
    st.lists(st.floats(0.01, 0.99), min_size=MOST, max_size=MOST),
)
def test_coordinates_are_there_and_back_the_same(name, machine, parts):
    """Values from coordinates, coordinates from values."""
    c = candidate(name, machine)
    z = inside(c, parts)
    found = c.given(z)
    again = c.coordinates(found)
    turned = np.array([2 * math.pi if p.cyclic else math.inf for p in c.parameters])
    away = np.abs(again - z)
    np.testing.assert_allclose(np.minimum(away, np.abs(away - turned)), 0.0, atol=1e-8)
    assert all(p.accepts(found[p.name]) for p in c.parameters)


@given(st.sampled_from(NAMES), st.lists(st.floats(-1e2, 1e2), min_size=MOST, max_size=MOST))
def test_whatever_the_coordinates_the_effect_accepts_the_values(name, z):
    """Also far outside the bounds, and for every machine."""
    for machine in MACHINES:
        c = candidate(name, machine)
        values = c.given(z[: len(c)])
        assert c.effect.check(values) == values


@pytest.mark.parametrize("machine", sorted(MACHINES))
@pytest.mark.parametrize("name", NAMES)
def test_a_search_begins_within_the_bounds_and_with_the_effect_there(name, machine):
    """No start is neutral, none outside, none twice, and there are not too many."""
    c = candidate(name, machine)
    starts = c.starts()
    low, high = c.bounds
    assert 0 < len(starts) <= MOST_STARTS
    for z in starts:
        assert np.all((z >= low - 1e-9) & (z <= high + 1e-9)), c.given(z)
        assert c.given(z) != c.effect.neutral
    assert len({tuple(np.round(z, 9)) for z in starts}) == len(starts)


@pytest.mark.parametrize("machine", sorted(MACHINES))
@pytest.mark.parametrize("name", NAMES)
def test_typical_values_are_allowed_and_not_neutral_on_every_machine(name, machine):
    """Sizes are scaled, bounds kept."""
    c = candidate(name, machine)
    assert c.typical == c.effect.check(c.typical)
    assert c.typical != c.effect.neutral


@pytest.mark.parametrize("name", NAMES)
def test_on_the_worked_case_the_librarys_own_numbers_hold(name):
    """Sizes are scaled for other machines only."""
    c = candidate(name)
    assert set(c.sizes.values()) == {1.0}
    assert c.typical == c.effect.check(c.effect.typical)


def test_factors_are_told_from_increments():
    """A logarithm for what multiplies and for limits, a difference for what adds."""
    kinds = {
        name: [logarithmic(p) for p in candidate(name).parameters]
        for name in ("inertia", "voltage_saturation", "foundation_damping", "coulomb_friction")
    }
    assert kinds == {
        "inertia": [True],
        "voltage_saturation": [True],
        "foundation_damping": [True, True],
        "coulomb_friction": [False],
    }
    inertia = candidate("inertia")
    up, down = inertia.coordinate(0, 2.0), inertia.coordinate(0, 0.5)
    assert up == pytest.approx(-down)


def test_a_small_motor_is_searched_with_small_torques():
    """The bundled motor stalls at an eighth of the rotor's torque, and a brake may stall it."""
    c = candidate("coulomb_friction", "motor")
    stall = MOTOR.parameters["K_t"] * 12.0 / MOTOR.parameters["R"]
    assert c.typical["torque"] == pytest.approx(0.05 * stall / 4.8)
    torques = [c.value(0, float(z[0])) for z in c.starts()]
    assert min(torques) < 0.002 * stall < 0.5 * stall < max(torques) < stall


@pytest.mark.parametrize(
    ("name", "end", "told"),
    [
        ("load_friction", 1, ["coefficient"]),  # no gear loses more: it would go on growing
        ("load_friction", 0, []),
        ("no_regeneration", 1, []),  # a whole share is a machine
        ("coulomb_friction", 0, []),
        ("inertia", 0, ["factor"]),
        ("inertia", 1, ["factor"]),
    ],
)
def test_a_fit_that_ends_where_the_search_does_is_told_from_one_at_the_end_of_physics(
    name, end, told
):
    """A factor, or a coefficient beyond any machine, has no size there; a friction of 0 has one."""
    c = candidate(name)
    assert c.at_limit(c.starts()[0]) == []
    assert c.at_limit(np.array([c.bounds[end][0]])) == told


@pytest.mark.parametrize("name", EFFECTS.names())
def test_half_as_strong_is_half_way_to_no_effect(name):
    """By what its first parameter adds to the machine's; a limit has no such measure."""
    c = candidate(name)
    z = c.starts()[-1]
    half = c.scaled(z, 0.5)
    first = c.parameters[0]
    if is_limit(first):
        assert half.tolist() == z.tolist()
        return
    whole, part, none = c.given(z)[first.name], c.given(half)[first.name], c.neutral(0)
    assert part - none == pytest.approx(0.5 * (whole - none))
    assert half[1:].tolist() == z[1:].tolist()
