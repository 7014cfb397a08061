"""The motor: linear, exact for held voltage, and started from what was measured."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from ldt_core.machine.machine_file import load_machine
from ldt_core.physics import PHYSICS
from ldt_core.physics.motor import MOTOR
from ldt_core.physics.rotor import ROTOR

VALUES = dict(load_machine("dc_motor").parameters)


def test_the_free_run_is_exact_for_held_voltage():
    """Equal to the closed form of the two-state system, sample by sample, to 1e-12."""
    a, b, c, d = MOTOR.state_space(VALUES)
    volts, state = [3.0, -7.0, 12.0, 0.0, 5.0], np.array([0.4, 2.0])
    states = MOTOR.simulate(VALUES, volts, 0.03, [0, 2.0, 0.4])
    for k, level in enumerate(volts):
        assert states[k, 1] == pytest.approx((c @ state + d[0] * level)[0], rel=1e-12)
        assert states[k, 2] == pytest.approx(state[0], rel=1e-12)
        steady = -np.linalg.solve(a, b[:, 0] * level)
        state = steady + expm(a * 0.03) @ (state - steady)


def test_it_settles_at_the_speed_where_voltage_and_friction_balance():
    """omega = K_t V / (K_t^2 + R b)."""
    p = VALUES
    speed = MOTOR.simulate(p, np.full(5000, 10.0), 0.01, np.zeros(3))[-1, 1]
    assert speed == pytest.approx(p["K_t"] * 10 / (p["K_t"] ** 2 + p["R"] * p["b"]), rel=1e-12)


def test_the_unmeasured_current_is_the_one_that_holds_the_speed():
    """A steady start stays: with V = R i + K_t w nothing changes."""
    start = MOTOR.initial_state(VALUES, 100.0)
    volts = np.full(500, VALUES["R"] * start[2] + VALUES["K_t"] * 100)
    speed = MOTOR.simulate(VALUES, volts, 0.01, start)[:, 1]
    np.testing.assert_allclose(speed, 100, rtol=1e-12)
    assert MOTOR.initial_state(VALUES, 100.0, 1.5)[2] == 1.5
    assert not MOTOR.initial_state(VALUES, 0.0).any()


def test_a_rotor_without_eccentricity_turns_like_the_motor():
    """The same motor parameters in the rotor's file: the same speeds."""
    rotor = dict(load_machine("rotor").parameters)
    motor = {p.name: rotor[p.name] for p in MOTOR.parameters}
    volts = np.random.default_rng(0).uniform(-24, 24, 200)
    one = ROTOR.simulate(rotor, volts, 0.01, np.zeros(7))[:, 1]
    two = MOTOR.simulate(motor, volts, 0.01, np.zeros(3))[:, 1]
    np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ["dc_motor", "dc_motor_rotor"])
def test_every_parameter_is_described_and_bounded_as_physics_has_it(name):
    """Masses, inertias, stiffnesses and the like above 0, damping and inductance from 0."""
    for p in PHYSICS.get(name).parameters:
        assert p.unit
        assert p.description
        assert not p.accepts(-1.0)
        assert p.accepts(0.0) == (p.name in ("L", "b", "R_x", "R_y", "e", "g"))
        assert (p.default is None) == (p.name not in ("e", "g"))
