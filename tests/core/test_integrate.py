"""The integrator: its order, its accuracy, its alignment with switches, its refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.base.errors import BadInput, LdtError
from ldt_core.effects import parse_effect
from ldt_core.machine.machine_file import load_machine
from ldt_core.physics.base import MAX_STEP, NOT_TRACKED
from ldt_core.physics.integrate import SMALL_TURN, turned
from ldt_core.physics.motor import MOTOR
from ldt_core.physics.rotor import ROTOR

PERIOD = 0.01
VALUES = dict(load_machine("rotor").parameters)
REST = np.zeros(7)


def steps(random, seconds=20, low=6.0, high=16.0):
    """Times and levels of an experiment with a random level each second, end included."""
    volts = np.repeat(random.uniform(low, high, seconds), 100)
    volts = np.append(volts, volts[-1])
    return np.arange(volts.size) * PERIOD, volts


def run(values, times, volts, step, physics=ROTOR):
    start = np.zeros(len(physics.states))
    return physics.integrate(values, times, (times, volts), start, (), step)


def test_the_order_is_four():
    """Halving the step divides the error by 16, at every halving within 15 %."""
    times, volts = steps(np.random.default_rng(0), 3)
    v = {**VALUES, "e": 0.008336}
    fine = run(v, times, volts, 3.125e-5)[:, 1]
    errors = [np.abs(run(v, times, volts, h)[:, 1] - fine).max() for h in (5e-4, 2.5e-4, 1.25e-4)]
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(16, rel=0.15)


@pytest.mark.slow
def test_the_default_step_is_accurate_on_random_experiments():
    """Worst relative speed error below 5e-6 at 0.25 ms; the median at 1 ms is about 2e-7."""
    random, v = np.random.default_rng(3), {**VALUES, "e": 0.008336}
    ours, coarse = [], []
    for _ in range(30):
        times, volts = steps(random)
        fine = run(v, times, volts, 6.25e-5)[:, 1]
        for row, h in ((ours, MAX_STEP), (coarse, 1e-3)):
            row.append(np.abs(run(v, times, volts, h)[:, 1] - fine).max() / fine.max())
    assert max(ours) < 5e-6
    assert np.median(coarse) == pytest.approx(2e-7, rel=0.5)


@given(theta=st.floats(-1e4, 1e4), delta=st.floats(-2 * SMALL_TURN, 2 * SMALL_TURN))
def test_sine_and_cosine_of_a_small_turn_are_exact(theta, delta):
    """The series agrees with the library to rounding, on both sides of its bound."""
    s, o = turned(math.sin(theta), math.cos(theta), theta, delta)
    assert s == pytest.approx(math.sin(theta + delta), abs=1e-15 + 2e-16 * abs(theta))
    assert o == pytest.approx(math.cos(theta + delta), abs=1e-15 + 2e-16 * abs(theta))


@given(seed=st.integers(0, 1000), foundation=st.floats(-0.01, 0.01))
def test_it_agrees_with_the_exact_solution_where_there_is_one(seed, foundation):
    """Ideal rotor, foundation swinging or not: within 1e-6 of the matrix exponential."""
    times, volts = steps(np.random.default_rng(seed), 3, -24, 24)
    start = np.array([0.3, -5, 1, foundation, 0.1, 0, -foundation])
    exact = ROTOR.simulate(VALUES, volts, PERIOD, start)
    ours = ROTOR.integrate(VALUES, times, (times, volts), start)
    np.testing.assert_allclose(ours[:, :2], exact[:, :2], atol=1e-6)
    np.testing.assert_allclose(ours[:, 3:], exact[:, 3:], atol=1e-6)


def test_steps_are_aligned_with_switches_between_the_samples():
    """A switch anywhere between two samples costs no accuracy, however coarse the samples."""
    v = dict(load_machine("dc_motor").parameters)
    times = np.array([0.0, 0.5])
    for switch in (0.1, 0.123456789, 0.49999):
        at, levels = np.array([0.0, switch]), np.array([10.0, -10.0])
        ours = MOTOR.integrate(v, times, (at, levels), np.zeros(3))[-1]
        middle = MOTOR.simulate(v, [10.0, 10.0], switch, np.zeros(3))[-1]
        exact = MOTOR.simulate(v, [-10.0, -10.0], 0.5 - switch, middle)[-1]
        np.testing.assert_allclose(ours, exact, atol=1e-6)


def test_a_stiffer_motor_gets_shorter_steps():
    """L/R of 10 microseconds: RK4 at 0.25 ms would explode; ours stays with the exact one."""
    v = {**load_machine("dc_motor").parameters, "L": 1e-5}
    times, volts = steps(np.random.default_rng(0), 2)
    exact = MOTOR.simulate(v, volts, PERIOD, np.zeros(3))
    ours = run(v, times, volts, MAX_STEP, MOTOR)
    np.testing.assert_allclose(ours[:, 1], exact[:, 1], atol=1e-3)


def test_a_hopelessly_stiff_machine_is_refused():
    """A foundation of 1e20 N/m swings so fast that it would take 7e10 steps."""
    times, volts = steps(np.random.default_rng(0))
    with pytest.raises(BadInput, match=r"fastest rate of at most .* \(sqrt\(K_x"):
        run({**VALUES, "K_x": 1e20}, times, volts, MAX_STEP)


def test_divergence_is_an_error_not_a_number():
    """A state that cannot be represented raises, with the time, instead of returning NaN."""
    times, volts = steps(np.random.default_rng(0), 1)
    start = REST.copy()
    start[1] = 1e200
    with pytest.raises(LdtError, match=r"diverged: its state is not finite .* s after the start"):
        ROTOR.integrate({**VALUES, "e": 0.01}, times, (times, volts), start)


def test_a_simulation_goes_on_where_an_earlier_one_ended():
    """Two halves, the second from the state of the first, equal the whole."""
    _, volts = steps(np.random.default_rng(0), 4)
    v = {**VALUES, "e": 0.01}
    whole = ROTOR.simulate(v, volts, PERIOD, REST)
    first = ROTOR.simulate(v, volts[:201], PERIOD, REST)
    second = ROTOR.simulate(v, volts[200:], PERIOD, first[-1])
    np.testing.assert_array_equal(first, whole[:201])
    np.testing.assert_allclose(second, whole[200:], rtol=1e-9, atol=1e-9)


STEEP = (
    "no_regeneration",
    "brush_drop",
    "load_friction:coefficient=0.4",
    "stribeck_friction:static=0.6",
    "cogging_torque",
    "winding_heating",
)


@pytest.mark.parametrize("eccentricity", [0.0, 0.004])
@pytest.mark.parametrize("effect", STEEP)
def test_a_search_takes_long_steps_only_where_they_do(effect, eccentricity):
    """A tenth of a sensor's noise at most from fine steps, also where an effect is steep."""
    values = VALUES | {"e": eccentricity}
    use, (_, volts) = [parse_effect(effect)], steps(np.random.default_rng(3), 10, -12.0, 12.0)
    found = [
        ROTOR.simulate(values, volts, PERIOD, REST, use, *how)[:, 1]
        for how in ((2e-3, NOT_TRACKED, 0.5e-3), (0.1e-3,))
    ]
    assert np.abs(found[0] - found[1]).max() < 0.01
    assert np.sqrt(np.mean((found[0] - found[1]) ** 2)) < 0.003
