"""The rotor: torque, jumps and energy that theory gives, recovered by simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.machine.machine_file import load_machine
from ldt_core.physics.steady_state import folds, steady_voltage, unbalance_torque

MACHINE = load_machine("rotor")
ROTOR = MACHINE.model
REST = np.zeros(7)


def values(**changes):
    return {**MACHINE.parameters, **changes}


def random_voltage(random, seconds=20, low=6.0, high=16.0, period=0.01):
    return np.repeat(random.uniform(low, high, seconds), round(1 / period))


@pytest.mark.parametrize("speed", [5.0, 16.5, 20.0, 28.57, 45.0, 60.0])
def test_at_prescribed_speed_the_foundation_takes_the_torque_of_the_formula(speed):
    """With an inertia that nothing can slow down, damper power / speed is T_e within 1e-8."""
    v = values(e=0.008336, J=1e12)
    turn = 2 * math.pi / speed
    settled, turns = 100 * math.ceil(60 / turn), 100 * 20
    volts = np.full(settled + turns, v["K_t"] * speed)
    start = ROTOR.initial_state(v, speed, 0.0)
    states = ROTOR.simulate(v, volts, turn / 100, start)[settled:]
    power = v["R_x"] * states[:, 4] ** 2 + v["R_y"] * states[:, 6] ** 2
    assert power.mean() / speed == pytest.approx(float(unbalance_torque(v, speed)), rel=1e-8)


@pytest.mark.parametrize(("e", "worst"), [(0.002, 1e-3), (0.004, 4e-3), (0.008336, 1.6e-2)])
def test_with_the_motor_free_the_mean_torque_stays_near_the_formula(e, worst):
    """Over whole turns in steady running; the ripple of the speed grows with e."""
    v = values(e=e)
    for level in (6.0, 9.5, 12.0):
        states = ROTOR.simulate(v, np.full(80_000, level), 0.002, REST)[60_000:]
        turns = math.floor((states[-1, 0] - states[0, 0]) / (2 * math.pi))
        stop = np.searchsorted(states[:, 0], states[0, 0] + 2 * math.pi * turns)
        speed, current = states[:stop, 1].mean(), states[:stop, 2].mean()
        torque = v["K_t"] * current - v["b"] * speed
        assert torque == pytest.approx(float(unbalance_torque(v, speed)), rel=worst)


def test_a_slow_ramp_jumps_where_the_folds_are():
    """0 to 24 V and back in 600 s each: up at 8.08 and 16.14 V, down at 10.99 and 6.11 V."""
    v = values(e=0.008336)
    n = 120_000
    volts = 24 * (1 - np.abs(1 - 2 * np.arange(n) / n))
    speed = ROTOR.simulate(v, volts, 0.01, REST)[:, 1]
    speed = np.convolve(speed, np.full(100, 0.01), "same")
    lower_x, upper_x, lower_y, upper_y = folds(v, 80)
    for low, high, up, after, down in [
        (lower_x, upper_x, 8.08, 24.6, 6.11),
        (lower_y, upper_y, 16.14, 48.6, 10.99),
    ]:
        unstable = (low.speed + high.speed) / 2
        rise = int(np.argmax(speed > unstable))
        fall = n - 1 - int(np.argmax(speed[::-1] > unstable))
        assert volts[rise] == pytest.approx(up, abs=0.05)
        assert volts[rise] == pytest.approx(low.voltage, abs=0.11)
        assert speed[rise - 400] == pytest.approx(low.speed, abs=0.2)
        assert speed[rise + 800] == pytest.approx(after, abs=1.0)
        assert volts[fall] == pytest.approx(down, abs=0.05)
        assert volts[fall] == pytest.approx(high.voltage, abs=0.05)


def test_the_folds_are_where_the_formula_has_them():
    """Four at 8.336 mm; the first appears at 1.99 mm in y and at 2.26 mm in x."""
    found = folds(values(e=0.008336), 80)
    assert [round(f.voltage, 2) for f in found] == [8.0, 6.15, 16.04, 10.99]
    assert [f.rising for f in found] == [True, False, True, False]
    assert [len(folds(values(e=e), 80)) for e in (0.00198, 0.002, 0.00225, 0.00227)] == [0, 2, 2, 4]


def test_steady_voltage_holds_its_speed():
    """Far from resonance, the simulated speed settles at the speed of the formula."""
    v = values(e=0.004)
    states = ROTOR.simulate(v, np.full(12_000, float(steady_voltage(v, 50.0))), 0.01, REST)
    assert states[-1000:, 1].mean() == pytest.approx(50, abs=0.01)


@pytest.mark.slow
def test_the_ideal_rotor_errs_as_the_square_of_the_eccentricity():
    """Mean maximum error of e = 0 against the truth over 40 random experiments of 20 s.

    Expected values from an independent simulation (0.6, 6.0, 11.9, 20.4 rad/s at 2, 6, 8.336, 12
    mm); the mean of 40 has a standard error of up to 0.5 rad/s.
    """
    random = np.random.default_rng(5)
    errors = {0.002: [], 0.006: [], 0.008336: [], 0.012: []}
    for _ in range(40):
        volts = random_voltage(random)
        ideal = ROTOR.simulate(values(), volts, 0.01, REST)[:, 1]
        for e, row in errors.items():
            true = ROTOR.simulate(values(e=e), volts, 0.01, REST)[:, 1]
            row.append(np.abs(true - ideal).max())
    mean = {e: np.mean(row) for e, row in errors.items()}
    assert mean[0.002] == pytest.approx(0.6, abs=0.06)
    assert mean[0.006] == pytest.approx(6.0, abs=0.8)
    assert mean[0.008336] == pytest.approx(11.9, abs=1.2)
    assert mean[0.012] == pytest.approx(20.4, abs=1.5)


def energy(v, states):
    """Kinetic, elastic, magnetic and potential energy of each state [J]."""
    theta, omega, current, x, vx, y, vy = states.T
    e, m = v["e"], v["m"]
    rotor = (vx - e * omega * np.sin(theta)) ** 2 + (vy + e * omega * np.cos(theta)) ** 2
    kinetic = (v["M"] * (vx**2 + vy**2) + m * rotor + v["J"] * omega**2) / 2
    elastic = (v["K_x"] * x**2 + v["K_y"] * y**2) / 2
    return kinetic + elastic + v["L"] * current**2 / 2 + m * v["g"] * e * np.sin(theta)


@given(
    e=st.floats(0, 0.012),
    g=st.floats(0, 10),
    levels=st.lists(st.floats(-24, 24), min_size=2, max_size=4),
    angle=st.floats(0, 6.3),
)
def test_energy_is_conserved(e, g, levels, angle):
    """What the supply gives less all losses is what is stored, to 1e-6 of what it gave."""
    v, half = values(e=e, g=g), 0.0001
    volts = np.append(np.repeat(levels, 2500), levels[-1])
    start = np.array([angle, 0, 0, 0.001, 0, 0, 0.02])
    states = ROTOR.simulate(v, volts, half, start)
    _, omega, current, _, vx, _, vy = states.T

    def simpson(power):
        return half / 3 * (power[:-1:2] + 4 * power[1::2] + power[2::2]).sum()

    mean_current = current[:-1:2] + 4 * current[1::2] + current[2::2]
    work = half / 3 * (volts[:-1:2] * mean_current).sum()
    given_in = half * np.abs(volts * current).sum() + 1e-3
    lost = simpson(v["R"] * current**2 + v["b"] * omega**2 + v["R_x"] * vx**2 + v["R_y"] * vy**2)
    stored = energy(v, states[[0, -1]])
    assert work - lost == pytest.approx(stored[1] - stored[0], abs=1e-6 * given_in)


def test_without_eccentricity_foundation_and_motor_do_not_know_each_other():
    """A foundation that still swings decays alone, and the speed is that of the motor."""
    volts = np.full(300, 9.0)
    swinging = np.array([0, 0, 0, 0.01, 0, -0.01, 0.1])
    v = values()
    states = ROTOR.simulate(v, volts, 0.01, swinging)
    np.testing.assert_array_equal(states[:, :3], ROTOR.simulate(v, volts, 0.01, REST)[:, :3])
    mass, t = v["M"] + v["m"], 2.99
    decay, w0 = v["R_x"] / mass / 2, math.sqrt(v["K_x"] / mass)
    w = math.sqrt(w0**2 - decay**2)
    expected = 0.01 * math.exp(-decay * t) * (math.cos(w * t) + decay / w * math.sin(w * t))
    assert states[-1, 3] == pytest.approx(expected, rel=1e-9)


def test_the_start_angle_turns_the_picture():
    """A quarter turn of the start angle changes the run on an anisotropic foundation."""
    v = values(e=0.008336)
    volts = random_voltage(np.random.default_rng(1))
    quarter = REST.copy()
    quarter[0] = math.pi / 2
    one, two = (ROTOR.simulate(v, volts, 0.01, s)[:, 1] for s in (REST, quarter))
    assert np.abs(one - two).max() > 0.1
    full = REST.copy()
    full[0] = 2 * math.pi
    np.testing.assert_allclose(ROTOR.simulate(v, volts, 0.01, full)[:, 1], one, atol=1e-6)
