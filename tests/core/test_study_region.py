"""The Sommerfeld region: where theory has two stable speeds or none, tidy against noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.lab.study.stream import in_region, intervals, region_rmse, speed_bands
from ldt_core.machine.machine_file import load_machine
from ldt_core.physics.steady_state import bands, folds, steady_voltage

MACHINE = load_machine("rotor")
HIGHEST = 70.0


def values(e):
    return {**MACHINE.parameters, "e": e}


def test_without_folds_there_is_no_region():
    """Below 1.99 mm every voltage holds one speed; the ideal rotor and a motor alone have none."""
    assert bands(values(0.0019), HIGHEST) == []
    assert bands(values(0.0), HIGHEST) == []
    assert len(bands(values(0.0021), HIGHEST)) == 1
    assert speed_bands(MACHINE, 0.0) == speed_bands(load_machine("dc_motor"), 0.008) == []


@pytest.mark.parametrize("e", [0.0025, 0.004, 0.008336, 0.012])
def test_a_band_begins_where_a_second_speed_exists_and_ends_with_the_unstable_branch(e):
    """Both ends take the voltage of the fold at which falling voltage lets the speed jump."""
    v = values(e)
    found, turning = bands(v, HIGHEST), folds(v, HIGHEST)
    assert len(found) == 2
    for (low, high), top, bottom in zip(found, turning[::2], turning[1::2], strict=True):
        assert high == bottom.speed
        assert low < top.speed < high
        assert float(steady_voltage(v, low)) == pytest.approx(bottom.voltage, rel=1e-9)


def test_the_bands_of_the_cited_rotor():
    """e = 8.336 mm: about both critical speeds, 16.50 and 28.57 rad/s."""
    first, second = speed_bands(MACHINE, 0.008336)
    assert first == pytest.approx((16.04, 17.68), abs=0.01)
    assert second == pytest.approx((27.57, 31.21), abs=0.01)


def test_a_band_whose_end_is_out_of_reach_ends_at_the_highest_speed():
    """Only speeds that the machine can have belong to the region."""
    assert bands(values(0.008336), 30.0)[-1][1] == 30.0


@given(st.floats(0.0, 0.06))
def test_bands_are_apart_and_in_order(e):
    """Whatever the eccentricity."""
    edges = [edge for band in bands(values(e), HIGHEST) for edge in band]
    assert edges == sorted(edges)
    assert all(0 < edge <= HIGHEST for edge in edges)


def test_a_captured_rotor_is_in_the_region_and_one_above_it_is_not():
    """At 12 V and 8.336 mm: captured from rest; not once it has been driven through."""
    v, period = values(0.008336), 0.01
    rest = MACHINE.model.initial_state(v, 0.0)
    where = speed_bands(MACHINE, 0.008336)
    captured = MACHINE.model.simulate(v, np.full(2000, 12.0), period, rest)[:, 1]
    driven = np.repeat([20.0, 12.0], 1000)
    above = MACHINE.model.simulate(v, driven, period, rest)[:, 1]
    assert in_region(captured, period, where)[-500:].all()
    assert not in_region(above, period, where)[-500:].any()


def test_noise_does_not_cut_the_region_into_pieces():
    """A speed that creeps into a band and out of it is in the region once."""
    creep = 30 - 4 * np.abs(np.linspace(-1, 1, 2000))
    noisy = creep + np.random.default_rng(0).normal(0, 0.1, 2000)
    clean = in_region(creep, 0.01, [(28.0, 31.0)])
    tidy = in_region(noisy, 0.01, [(28.0, 31.0)])
    assert intervals(clean) == [(500, 1500)]
    assert len(intervals((noisy >= 28.0) & (noisy <= 31.0))) > 5
    assert len(intervals(tidy)) == 1
    assert np.abs(creep[tidy != clean] - 28.0).max() < 0.3  # three deviations of the noise


def test_a_quick_passage_is_no_capture():
    """0.1 s in the band is left out, 0.3 s counts; both edges of an experiment count too."""
    speed = np.full(1000, 20.0)
    speed[100:110] = speed[300:330] = speed[:25] = speed[-25:] = 29.0
    assert intervals(in_region(speed, 0.01, [(28.0, 31.0)])) == [(0, 25), (300, 330), (975, 1000)]


def test_turning_backwards_is_the_same():
    """The foundation does not know the sense of rotation."""
    speed = np.full(100, -29.0)
    assert in_region(speed, 0.01, [(28.0, 31.0)]).all()


def test_the_error_in_the_region_by_hand():
    """Only samples inside count; None without any."""
    residual, mask = np.array([9.0, 3.0, 4.0]), np.array([False, True, True])
    assert region_rmse(residual, mask) == pytest.approx(np.sqrt(12.5))
    assert region_rmse(residual, np.zeros(3, dtype=bool)) is None
