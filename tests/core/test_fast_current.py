"""The current solved for where it is faster than the steps, down to no inductance at all."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ldt_core.effects import parse_effect
from ldt_core.machine.machine_file import load_machine
from ldt_core.physics import motor_driven
from ldt_core.physics.motor import MOTOR
from ldt_core.physics.rotor import ROTOR

PERIOD = 0.01
MACHINE = dict(load_machine("dc_motor").parameters)
VOLTS = np.repeat(np.random.default_rng(0).uniform(-12.0, 12.0, 4), 4)
TIMES = np.arange(VOLTS.size) * PERIOD
SEARCH = {"max_step": 2e-3, "least_step": 0.5e-3}  # as a diagnosis simulates


def independent(values, effects):
    """(L, 3) states by scipy's Radau method, restarted at each switch of the voltage."""
    state, found = np.zeros(3), [np.zeros(3)]
    terms = [
        (e, [*(p[q.name] for q in e.parameters), *(values[n] for n in e.needs)]) for e, p in effects
    ]
    for volts in VOLTS[:-1]:

        def rates(t, y, volts=volts):
            torque, terminal = 0.0, volts
            for e, p in terms:
                torque += e.torque(t, *y, volts, p) if e.torque else 0.0
                terminal += e.terminal(t, *y, volts, p) if e.terminal else 0.0
            alpha = (values["K_t"] * y[2] - values["b"] * y[1] + torque) / values["J"]
            drop = values["R"] * y[2] + values["K_t"] * y[1]
            return [y[1], alpha, (terminal - drop) / values["L"]]

        how = {"method": "Radau", "rtol": 1e-7, "atol": 1e-9}
        state = solve_ivp(rates, (0, PERIOD), state, **how).y[:, -1]
        found.append(state)
    return np.array(found)


@pytest.mark.parametrize("time_constant", [1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize(
    ("effect", "tolerance"),
    # rad/s, at most a tenth of the machine's noise of 0.1; dry friction is steepest at standstill
    [("brush_drop", 4e-3), ("coulomb_friction", 0.01)],
)
def test_it_agrees_with_an_independent_integrator(time_constant, effect, tolerance):
    """Five decades of L/R, at a search's long steps too; an explicit step of 0.5 ms explodes."""
    values = {**MACHINE, "L": MACHINE["R"] * time_constant}
    use = [parse_effect(effect)]
    true = independent(values, use)
    for how in ({}, SEARCH):
        ours = MOTOR.simulate(values, VOLTS, PERIOD, np.zeros(3), use, **how)
        assert np.abs(ours[:, 1] - true[:, 1]).max() < tolerance


@pytest.mark.parametrize("time_constant", [0.0, 1e-9, 1e-6, 1e-4])
@pytest.mark.parametrize("physics", [MOTOR, ROTOR])
def test_the_ideal_machine_is_exact_however_fast_its_current(physics, time_constant):
    """The steps give the matrix exponential's states."""
    values = dict(load_machine("dc_motor" if physics is MOTOR else "rotor").parameters)
    values["L"] = values["R"] * time_constant
    start = np.zeros(len(physics.states))
    exact = physics.simulate(values, VOLTS, PERIOD, start)
    ours = physics.integrate(values, TIMES, (TIMES, VOLTS), start)
    np.testing.assert_allclose(ours, exact, atol=1e-6)


def test_a_winding_without_inductance_is_one_with_hardly_any():
    """L = 0 is a machine: its current follows at once, and a microhenry moves no speed by 1e-3."""
    use = [parse_effect("brush_drop"), parse_effect("load_friction")]
    without, hardly = (
        MOTOR.simulate({**MACHINE, "L": x}, VOLTS, PERIOD, np.zeros(3), use) for x in (0.0, 1e-6)
    )
    assert np.abs(without - hardly)[:, 1].max() < 1e-3
    machine = load_machine("dc_motor").with_parameters(L=0.0)
    steady = machine.model.simulate(machine.parameters, [6.0] * 1000, PERIOD, np.zeros(3))[-1]
    k, r, b = (MACHINE[n] for n in ("K_t", "R", "b"))
    assert steady[1] == pytest.approx(6.0 * k / (r * b + k * k), rel=1e-6)


@pytest.mark.parametrize("voltage", [1.0, 5.0, 10.0])
@pytest.mark.parametrize("inductance", [0.0, 1e-6, 1e-4])
@pytest.mark.parametrize("eccentricity", [0.0, 0.004])
def test_a_steep_brush_is_solved(voltage, inductance, eccentricity):
    """The drop turns its sign a hundred times faster than the winding: Newton's steps find it."""
    values = {**load_machine("rotor").parameters, "e": eccentricity, "L": inductance}
    use, start = [parse_effect(f"brush_drop:voltage={voltage}")], np.zeros(7)
    coarse, fine = (
        ROTOR.simulate(values, VOLTS, PERIOD, start, use, **how)
        for how in (SEARCH, {"max_step": 0.05e-3})
    )
    assert np.abs(coarse - fine)[:, 1].max() < 2e-3


def test_a_machine_with_an_ample_inductance_is_stepped_as_ever(monkeypatch):
    """Runge-Kutta to the last bit where its steps follow the current anyway."""

    def never(*_given):
        raise AssertionError("the current is slow")

    monkeypatch.setattr(motor_driven, "_collocated", never)
    values = {**load_machine("rotor").parameters, "e": 0.004}
    use = [parse_effect("coulomb_friction"), parse_effect("winding_heating")]
    ROTOR.simulate(values, VOLTS, PERIOD, np.zeros(7), use)
    with pytest.raises(AssertionError, match="slow"):
        ROTOR.simulate({**values, "L": 1e-4}, VOLTS, PERIOD, np.zeros(7), use)
