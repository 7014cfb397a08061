"""Explicit steps about the exponential of the motor: stable and exact however fast the current."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from ldt_core.base.errors import LdtError
from ldt_core.effects import parse_effect
from ldt_core.machine.machine_file import load_machine
from ldt_core.physics import motor_driven
from ldt_core.physics.effect import Effect
from ldt_core.physics.motor import MOTOR
from ldt_core.physics.motor_functions import motor_functions
from ldt_core.physics.rotor import ROTOR

PERIOD = 0.01
VOLTS = np.repeat(np.random.default_rng(1).uniform(-20.0, 20.0, 6), 5)
SEARCH = {"max_step": 5e-3, "least_step": 0.5e-3}  # as a diagnosis simulates
DECADES = [1e-8, 1e-6, 1e-5, 5e-5, 2e-4]


def of_rotor(values, effect, given):
    """(L,) speed by scipy's Radau method, of the equations solved for both accelerations."""
    v = values
    total, me = v["M"] + v["m"], v["m"] * v["e"]
    numbers = [*(given[q.name] for q in effect.parameters), *(v[n] for n in effect.needs)]
    state, found = np.zeros(7), [0.0]
    for volts in VOLTS[:-1]:

        def rates(t, y, volts=volts):
            theta, w, i, x, vx, z, vz = y
            s, o = np.sin(theta), np.cos(theta)
            torque = effect.torque(t, theta, w, i, volts, numbers)
            # Newton for foundation and shaft together, as a 3 x 3 system for the accelerations.
            a = np.array(
                [
                    [v["J"] + me * v["e"], -me * s, me * o],
                    [-me * s, total, 0.0],
                    [me * o, 0.0, total],
                ]
            )
            b = np.array(
                [
                    v["K_t"] * i - v["b"] * w - me * v["g"] * o + torque,
                    -v["R_x"] * vx - v["K_x"] * x + me * w * w * o,
                    -v["R_y"] * vz - v["K_y"] * z + me * w * w * s,
                ]
            )
            alpha, ax, az = np.linalg.solve(a, b)
            di = (volts - v["R"] * i - v["K_t"] * w) / v["L"]
            return [w, alpha, di, vx, ax, vz, az]

        how = {"method": "Radau", "rtol": 1e-8, "atol": 1e-10}
        state = solve_ivp(rates, (0, PERIOD), state, **how).y[:, -1]
        found.append(state[1])
    return np.array(found)


@pytest.mark.parametrize("time_constant", DECADES)
@pytest.mark.parametrize("effect", ["constant_load:torque=0", "cogging_torque", "quadratic_drag"])
def test_a_shaking_rotor_agrees_with_an_independent_integrator(time_constant, effect, monkeypatch):
    """To a tenth of the noise of 0.1 rad/s in a search, a hundredth else."""
    monkeypatch.setattr("ldt_core.physics.fast_current.collocate", None)
    values = {**load_machine("rotor").parameters, "e": 0.008, "g": 9.81}
    values["L"] = values["R"] * time_constant
    use = parse_effect(effect)
    true = of_rotor(values, *use)
    for how, within in (({}, 1e-3), (SEARCH, 1e-2)):
        ours = ROTOR.simulate(values, VOLTS, PERIOD, np.zeros(7), [use], **how)
        assert np.abs(ours[:, 1] - true).max() < within


@pytest.mark.parametrize("h", [1e-9, 1e-3, 0.1, 10.0])
@pytest.mark.parametrize("loss", [2.0, 40.0, 44.0, 1e7])
def test_the_functions_of_the_motor_are_those_of_its_matrix(h, loss):
    """phi_0 to phi_3 from one exponential of a larger matrix (Al-Mohy, Higham 2011)."""
    pull, drag, emf = 11.0, 0.2, 44.0
    a = np.array([[-drag, pull], [-emf, -loss]])
    big = np.zeros((8, 8))
    big[:2, :2] = h * a
    for k in range(3):
        big[2 * k : 2 * k + 2, 2 * k + 2 : 2 * k + 4] = np.eye(2)
    expected, ours = expm(big)[:2], np.empty((4, 2, 2))
    motor_functions(pull, drag, emf, loss, h, ours)
    for k in range(4):
        np.testing.assert_allclose(ours[k], expected[:, 2 * k : 2 * k + 2], rtol=1e-8, atol=1e-12)


def collocated(monkeypatch, effect, time_constant, **how):
    """Whether a motor with this effect is solved by collocation."""
    used = []
    fast = motor_driven._collocated
    monkeypatch.setattr(
        motor_driven, "_collocated", lambda *about: (used.append(1), fast(*about))[1]
    )
    values = dict(load_machine("dc_motor").parameters)
    values["L"] = values["R"] * time_constant
    MOTOR.simulate(values, VOLTS, PERIOD, np.zeros(3), [effect], **how)
    return bool(used)


@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        ("gravity_imbalance", False),
        ("brush_drop", True),  # a voltage bends with the current
        ("load_friction", True),  # a torque reads the current
        ("coulomb_friction", False),  # steeper than a search's steps: shorter ones cost less
        ("coulomb_friction:torque=5", True),  # too steep for those as well
    ],
)
def test_what_knows_the_current_or_is_steep_is_solved_for(monkeypatch, effect, expected):
    assert collocated(monkeypatch, parse_effect(effect), 1e-6, **SEARCH) is expected


def test_a_slow_current_asks_for_neither(monkeypatch):
    assert not collocated(monkeypatch, parse_effect("brush_drop"), 5e-3, **SEARCH)


def test_what_a_term_reads_is_what_its_code_names():
    def torque(time, angle, speed, amps, volts, p):
        return -p[0] * speed * (amps + 1.0)

    effect = Effect("odd", "d", "e", (), torque=torque)
    assert effect.reads == {"omega", "current"}

    class Callable:
        def __call__(self, *about):
            return 0.0

    assert "current" in Effect("odd", "d", "e", (), torque=Callable()).reads


def test_a_search_gives_up_at_once_what_its_steps_cannot_follow():
    """A light far end on a stiff shaft: 20 s of it took 1.5 s of a processor."""
    values = {**load_machine("dc_motor").parameters, "L": 0.0}
    use = parse_effect("torsional_compliance:share=6e-5,stiffness=38,damping=0.14")
    about = values, VOLTS, PERIOD, np.zeros(3), [use]
    with pytest.raises(LdtError, match="do not follow"):
        MOTOR.simulate(*about, **SEARCH)


def test_a_ripple_that_turns_by_whole_periods_in_a_step_is_no_quiet_one():
    """Twelve periods a turn at 209 rad/s: each 2.5 ms, the stages of a long step saw the same."""
    values = dict(load_machine("dc_motor").parameters)
    values["L"] = values["R"] * 5e-5
    use = [parse_effect("cogging_torque:torque=0.02,periods=12")]
    volts = np.repeat(np.linspace(10.6, 11.2, 7), 50)
    fine, searched = (
        MOTOR.simulate(values, volts, 0.01, np.zeros(3), use, **how)[:, 1]
        for how in ({"max_step": 1e-4}, SEARCH)
    )
    assert np.abs(searched - fine).max() < 0.02
