"""The mean torque over a quantity: linear algebra that must give back what was put in."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from ldt_core.diagnosis import torque_curve as module
from ldt_core.diagnosis.torque_curve import KNOTS, torque_curve

pytestmark = pytest.mark.slow

INERTIA, MEMORY, PERIOD, LENGTH = 0.02, 0.3, 0.01, 1500
NOISE = 0.05


def ramps(count=4, low=0.0, high=50.0):
    """(L,) a quantity that goes up and down in each experiment, at another pace."""
    time = np.arange(LENGTH) * PERIOD
    middle, half = (low + high) / 2, (high - low) / 2
    return [middle - half * np.cos(2 * np.pi * (k + 1) * time / time[-1]) for k in range(count)]


def moved(torque):
    """(L,) what a torque does to the speed of a motor that is at rest first."""
    decay = np.exp(-PERIOD / MEMORY)
    return lfilter([0.0, MEMORY / INERTIA * (1 - decay)], [1.0, -decay], torque)


def found(quantity, residuals, rest=True, noise=NOISE):
    count = len(quantity)
    return torque_curve(
        residuals, quantity, [PERIOD] * count, [rest] * count, INERTIA, MEMORY, noise
    )


def band(q):
    return np.where((q > 20.0) & (q < 24.0), -0.1, 0.0)


def test_a_torque_at_some_speeds_is_found_there_and_nowhere_else():
    """To a fifth of its size, one knot away from its edges."""
    random = np.random.default_rng(1)
    quantity = ramps()
    curve = found(quantity, [moved(band(q)) + random.normal(0, NOISE, LENGTH) for q in quantity])
    step = curve.knots[1] - curve.knots[0]
    clear = np.minimum(np.abs(curve.knots - 20.0), np.abs(curve.knots - 24.0)) > 2 * step
    assert curve.torque[clear] == pytest.approx(band(curve.knots)[clear], abs=0.02)
    assert curve.explained > 0.9
    assert curve.knots.size == KNOTS


def test_the_deviation_covers_what_noise_makes_of_it():
    """Of smooth torques, within two deviations in at least nine of ten knots."""
    quantity = ramps()
    truth = 0.05 * np.sin(np.linspace(0, 6, KNOTS))
    inside = []
    for seed in range(10):
        random = np.random.default_rng(seed)
        torques = [np.interp(q, np.linspace(0, 50, KNOTS), truth) for q in quantity]
        curve = found(quantity, [moved(m) + random.normal(0, NOISE, LENGTH) for m in torques])
        inside.append(np.mean(np.abs(curve.torque - truth) < 2 * curve.deviation))
    assert np.mean(inside) > 0.9


def test_noise_alone_depends_on_nothing():
    """No torque that is larger than its deviation allows, and hardly anything explained."""
    random = np.random.default_rng(2)
    quantity = ramps()
    noise = [random.normal(0, NOISE, LENGTH) for _ in quantity]
    curve = found(quantity, noise, noise=0.9 * NOISE)
    assert curve.explained < 0.05
    assert np.mean(np.abs(curve.torque) < 3 * curve.deviation) > 0.95


def test_an_unknown_first_speed_is_no_torque():
    """It decays as the motor forgets it; where the machine was not at rest it is projected out."""
    quantity = ramps()
    first = 3.0 * np.exp(-np.arange(LENGTH) * PERIOD / MEMORY)
    wrong = [moved(band(q)) + first for q in quantity]
    right = found(quantity, [moved(band(q)) for q in quantity], rest=False, noise=0.0)
    curve = found(quantity, wrong, rest=False, noise=0.0)
    assert curve.torque == pytest.approx(right.torque, abs=1e-6)


@pytest.fixture(scope="module")
def in_our_units():
    """Quantity, residuals and what is found of them."""
    quantity = ramps(2)
    random = np.random.default_rng(3)
    wrong = [moved(band(q)) + random.normal(0, NOISE, LENGTH) for q in quantity]
    return quantity, wrong, found(quantity, wrong)


@settings(max_examples=12)  # each takes 0.2 s; a scale that matters does so at any
@example(1e-3, 1e2)
@example(1e3, 1e-2)
@given(st.floats(1e-3, 1e3), st.floats(1e-2, 1e2))
def test_units_do_not_matter(in_our_units, torque, speed):
    """Twice the torque is found twice as large, and a quantity in other units is the same one."""
    quantity, wrong, one = in_our_units
    other = found([speed * q for q in quantity], [torque * w for w in wrong], noise=torque * NOISE)
    size = np.abs(one.torque).max()
    assert other.torque / torque == pytest.approx(one.torque, abs=1e-3 * size)
    assert other.explained == pytest.approx(one.explained, abs=1e-6)


def test_a_long_experiment_is_worked_on_in_blocks(monkeypatch):
    """With the same result, from rest and from an unknown first speed."""
    random = np.random.default_rng(4)
    quantity = ramps(2)
    wrong = [moved(band(q)) + random.normal(0, NOISE, LENGTH) for q in quantity]
    for rest in (True, False):
        monkeypatch.setattr(module, "BLOCK", 20_000)
        whole = found(quantity, wrong, rest)
        monkeypatch.setattr(module, "BLOCK", 700)
        parts = found(quantity, wrong, rest)
        assert parts.torque == pytest.approx(whole.torque, abs=1e-9)  # of 0.1 N m
        assert parts.explained == pytest.approx(whole.explained, rel=1e-9)
