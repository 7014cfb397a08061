"""The suite for a physics of one's own holds for ours and notices what is wrong with another."""

from __future__ import annotations

import pytest

from ldt_core.calibration import calibrate
from ldt_core.checks import check_physics
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.physics import PHYSICS
from ldt_core.physics.base import Physics
from ldt_core.physics.motor import MOTOR, Motor


@pytest.mark.parametrize("name", ["rotor", "dc_motor"])
def test_ours_pass(name):
    """Those that ship with LDT."""
    assert len(check_physics(load_machine(name))) >= 2


def of(kind: type[Physics], monkeypatch: pytest.MonkeyPatch) -> Machine:
    """The motor's file with another physics."""
    monkeypatch.setitem(vars(PHYSICS), "get", lambda _name: kind())
    return load_machine("dc_motor")


def test_equations_that_differ_are_noticed(monkeypatch):
    """An inertia that the exact solution has and the integrator has not."""

    class Heavier(Motor):
        name = "heavier"

        def system(self, values):
            return super().system({**values, "J": 2 * values["J"]})

    with pytest.raises(AssertionError, match="`system` and `constants` tell of different"):
        check_physics(of(Heavier, monkeypatch))


def test_a_state_space_of_another_machine_is_noticed(monkeypatch):
    """Learned models begin with it."""

    class Lighter(Motor):
        name = "lighter"

        def state_space(self, values):
            return super().state_space({**values, "J": values["J"] / 2})

    with pytest.raises(AssertionError, match="`system` and `state_space` tell of different"):
        check_physics(of(Lighter, monkeypatch))


def test_a_rate_that_is_too_low_is_noticed(monkeypatch):
    """It would make the integration step too long."""

    class Slow(Motor):
        name = "slow"

        def rate(self, values, voltage):
            return 0.5 * super().rate(values, voltage)

    with pytest.raises(AssertionError, match="`rate` is"):
        check_physics(of(Slow, monkeypatch))


def test_states_that_no_effect_can_act_on_are_said(monkeypatch):
    """A linear physics with one more state is used, and said to be beyond a diagnosis."""

    class Longer(Motor):
        name = "longer"
        states = (*Motor.states, "turns")

        def system(self, values):
            import numpy as np

            a, b = super().system(values)
            return np.pad(a, (0, 1)), np.pad(b, (0, 1))

    assert "cannot be diagnosed" in check_physics(of(Longer, monkeypatch))[-1]


def test_a_simulator_of_somebody_else_is_used_through_the_narrow_interface(monkeypatch):
    """One that has no equations for our integrator is checked, simulated and calibrated."""

    class Elsewhere(Physics):
        name, parameters, states = "elsewhere", Motor.parameters, Motor.states
        is_linear = staticmethod(MOTOR.is_linear)
        state_space = staticmethod(MOTOR.state_space)
        initial_state = staticmethod(MOTOR.initial_state)
        simulate = staticmethod(MOTOR.simulate)

    machine = of(Elsewhere, monkeypatch)
    assert len(check_physics(machine)) == 2
    plant = Plant(machine, experiments=2, seed=1, degradation="none", noise=0.05)
    found = calibrate(machine, [plant.experiment(i) for i in (1, 2)], free=["K_t"])
    assert found.machine.parameters["K_t"] == pytest.approx(0.05, rel=1e-3)
