"""What a machine file knows of its own numbers, far along what it does not know."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recorded_machines import MOTOR, ROTOR, record

from ldt_core.calibration.calibrate import calibrate
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.nominal import as_calibrated
from ldt_core.diagnosis.nominal_prior import MOTOR as NUMBERS
from ldt_core.diagnosis.nominal_prior import (
    NominalPrior,
    _coefficients,
    masses_leave_open,
    merged,
    nominal_prior,
)
from ldt_core.effects import get_effect

OWN = replace(MOTOR, parameters={"J": 6e-5, "K_t": 0.05, "R": 5.0, "L": 0.002, "b": 3e-5})


def slopes(machine) -> np.ndarray:
    """(3, 5) of the transfer function's coefficients, on the numbers' logarithms."""
    logs = np.log([machine.parameters[n] for n in NUMBERS])
    return np.array(
        [(_coefficients(logs + d) - _coefficients(logs - d)) / 2e-5 for d in 1e-5 * np.eye(5)]
    ).T


@given(z=st.tuples(st.floats(-3, 3), st.floats(-3, 3)))
def test_what_was_calibrated_is_kept_however_far_the_rest_moves(z):
    """Along what the transfer function does not tell, it stays, although the numbers double."""
    unknown = np.linalg.svd(slopes(OWN))[2][3:].T
    prior = NominalPrior(OWN, NUMBERS, 0.1 * unknown, curved=True)
    factors = prior.factors(np.array(z))
    moved = np.log([OWN.parameters[n] * factors[n] for n in NUMBERS])
    before = _coefficients(np.log([OWN.parameters[n] for n in NUMBERS]))
    np.testing.assert_allclose(_coefficients(moved), before, atol=1e-6)


def test_a_short_move_is_the_posteriors():
    """To first order nothing else has changed."""
    root = np.random.default_rng(0).normal(size=(5, 3)) * 1e-4
    straight, curved = (NominalPrior(OWN, NUMBERS, root, curved=c) for c in (False, True))
    z = np.array([1.0, -1.0, 0.5])
    one, other = (np.log(list(p.factors(z).values())) for p in (straight, curved))
    np.testing.assert_allclose(other, one, atol=1e-7)


@pytest.mark.slow
def test_a_brake_is_no_number_of_the_file():
    """The file's posterior is long where b and K_t make up for each other, and is curved there."""
    recording = {"count": 6, "samples": 500, "volts": (-24, 24), "hold": 50, "noise": 0.3}
    sheet = {"J": 1.01, "K_t": 0.944, "R": 1.05, "L": 0.88, "b": 2.4}
    start = replace(OWN, parameters={n: v * sheet[n] for n, v in OWN.parameters.items()})
    file = calibrate(start, record(OWN, **recording)).machine
    braked = record(OWN, "viscous_friction:b=5e-5", seed=2, **recording)
    tried = ("viscous_friction", "coulomb_friction", "quadratic_drag", "motor_constant", "inertia")
    effects = [get_effect(n) for n in (*tried, "armature_resistance", "sensor_gain", "input_gain")]
    found = diagnose(file, braked, effects=effects, workers=1)
    assert found.verdict.acting == [["viscous_friction"]]
    assert found.gap.after.rmse < 1.1 * 0.3


def test_a_number_that_closes_most_of_the_gap_is_told_beside_the_effect_named():
    """A tolerance of 20 % took up an inertia that had grown by 35 %, without a word."""
    told = ("inertia:factor=1.35", "coulomb_friction:torque=0.01")
    loose = replace(MOTOR, deviations={"J": 0.2})
    effects = [get_effect(n) for n in ("coulomb_friction", "quadratic_drag", "inertia")]
    found = diagnose(loose, record(MOTOR, *told, count=4, seed=3, noise=0.1), effects=effects)
    assert found.verdict.acting == [["coulomb_friction"]]
    assert "Fitted along, within their tolerances: J × 1.35. Such" in found.verdict.sentence


def test_a_mass_that_is_off_is_a_stiffness_damping_and_unbalance_that_are():
    """The speed is the same to a thousandth of what the unbalance does."""
    off = {"m": 1.04, "M": 0.97}
    own = replace(ROTOR, parameters={n: v * off.get(n, 1.0) for n, v in ROTOR.parameters.items()})
    part = np.array([ROTOR.parameters[n] for n in off]) / sum(ROTOR.parameters[n] for n in off)
    whole = float(part @ list(off.values()))
    stands = {n: 1 / whole for n in ("K_x", "K_y", "R_x", "R_y")}
    alike = replace(
        ROTOR, parameters={n: v * stands.get(n, 1.0) for n, v in ROTOR.parameters.items()}
    )
    e = 0.003
    kwargs = {"count": 1, "samples": 2000, "volts": (3.0, 14.0), "hold": 100, "noise": 0.0}
    (one,) = record(own, f"unbalance:e={e}", **kwargs)
    (other,) = record(alike, f"unbalance:e={e * 1.04 / whole**0.5}", **kwargs)
    (none,) = record(ROTOR, **kwargs)
    rms = [float(np.sqrt(np.mean((a.speed - one.speed) ** 2))) for a in (other, none)]
    assert rms[0] < 2e-3 * rms[1]
    told = masses_leave_open(ROTOR.with_deviations({n: 0.01 * ROTOR.parameters[n] for n in off}))
    np.testing.assert_allclose(told["K_x"], -0.01 * part)
    np.testing.assert_allclose(told["e"], 0.01 * (np.array([1.0, 0.0]) - part / 2))


def test_a_file_that_left_as_much_when_it_was_calibrated_is_told_so():
    """Of a sensor with coloured noise no effect explains what is left."""
    file = replace(ROTOR, calibration={"held_out": {"rmse_after": 0.12}})
    assert "0.12 rad/s" in as_calibrated(file, 0.13)
    assert as_calibrated(file, 0.2) == ""
    assert as_calibrated(ROTOR, 0.0) == ""


def test_what_the_masses_move_can_be_read_back_as_effects():
    """A heavier rotor has an e below the file's, which no effect can lower."""
    heavy = replace(ROTOR.with_parameters(e=0.005), deviations={"m": 0.05, "J": 0.01})
    whole = nominal_prior(heavy).candidate()
    for sign in (1.0, -1.0):
        moved = whole.given(np.full(len(whole), sign))
        for effect, values in merged(heavy, [(whole.effect, moved)]):
            assert effect.check(values) == values
