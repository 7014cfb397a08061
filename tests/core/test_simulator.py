"""Somebody else's engine as the physics: effects act on it as on the equations of our own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ldt_core.base import slow_runs
from ldt_core.base.errors import LdtError, MachineFileError
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.effects import EFFECTS, get_effect
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.physics import PHYSICS
from ldt_core.physics.base import Physics
from ldt_core.physics.motor import MOTOR, Motor
from ldt_core.physics.simulator import Simulator

VALUES = {"J": 1e-3, "K_t": 0.05, "R": 1.0, "L": 2e-3, "b": 1e-4}
PERIOD = 0.01


class Engine(Simulator):
    """A motor by semi-implicit Euler steps, which stands for an engine."""

    name, parameters, step = "engine", Motor.parameters, 1e-4

    def advance(self, values, state, voltage, torque, duration):
        theta, omega, current = state
        aim = (voltage - values["K_t"] * omega) / values["R"]
        current = aim + (current - aim) * math.exp(-duration * values["R"] / values["L"])
        push = values["K_t"] * current + torque - values["b"] * omega
        omega += duration * push / values["J"]
        return theta + duration * omega, omega, current


def voltage() -> np.ndarray:
    return np.repeat([6.0, -4.0, 0.0, 8.0], 40)


@pytest.mark.parametrize("name", [n for n in EFFECTS.names() if not n.startswith("foundation")])
def test_every_effect_acts_as_on_our_own_equations(name):
    """To the first order of the step, whichever stage it acts on, own states included."""
    effect = get_effect(name)
    try:
        effect.require(MOTOR)
    except LdtError:
        pytest.skip("the motor alone cannot have it")
    acting = [(effect, effect.check(effect.typical))]
    initial = MOTOR.initial_state(VALUES, 5.0)
    ours = MOTOR.simulate(VALUES, voltage(), PERIOD, initial, acting)
    engine, shown, off = Engine(), MOTOR.measure(ours, PERIOD, acting), []
    for step in (1e-4, 0.5e-4):
        engine.step = step
        theirs = engine.simulate(VALUES, voltage(), PERIOD, initial, acting)
        assert theirs.shape == ours.shape
        off.append(np.abs(engine.measure(theirs, PERIOD, acting) - shown).max())
    healthy = MOTOR.simulate(VALUES, voltage(), PERIOD, initial)[:, 1]
    size = max(np.abs(shown - healthy).max(), 1.0)
    assert off[0] < 0.1 * size
    assert off[1] < max(0.7 * off[0], 1e-3 * size)


def test_a_run_follows_the_measured_speed_as_ours_does():
    initial, measured = np.zeros(3), np.linspace(0, 80, voltage().size)
    about = VALUES, voltage(), PERIOD, initial
    ours = MOTOR.simulate(*about, tracked=(measured, 0.3))
    theirs = Engine().simulate(*about, tracked=(measured, 0.3))
    assert np.abs(ours - theirs)[:, 1].max() < 0.5


def machine(kind: type[Simulator], monkeypatch: pytest.MonkeyPatch) -> Machine:
    monkeypatch.setitem(vars(PHYSICS), "get", lambda _name: kind())
    return load_machine("dc_motor")


@pytest.mark.slow
def test_a_diagnosis_names_what_acts_on_an_engine(monkeypatch):
    """All of its search runs through `advance`."""

    class Coarse(Engine):
        step = 2.5e-3

    engine = machine(Coarse, monkeypatch)
    acting = [(get_effect("viscous_friction"), {"b": 4e-4})]
    plant = Plant(engine, experiments=2, seed=3, degradation="none", noise=0.05, effects=acting)
    experiments = [e.part(0, 120) for e in (plant.experiment(i) for i in (1, 2))]
    effects = [get_effect("viscous_friction"), get_effect("sensor_gain")]
    found = diagnose(engine, experiments, effects=effects, workers=1)
    assert found.verdict.acting == [["viscous_friction"]]


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (lambda state: state[:2], r"expected 3 states \(theta, omega, current\), got .*2"),
        (lambda state: None, r"engine, advance: expected 3 states .*, got None"),
        (lambda state: 1 / 0, "engine, advance: ZeroDivisionError"),
        (lambda state: state * np.nan, "engine diverged"),
    ],
)
def test_an_engine_that_fails_is_told(answer, sentence):
    class Broken(Engine):
        def advance(self, values, state, voltage, torque, duration):
            return answer(state)

    with pytest.raises(LdtError, match=sentence):
        Broken().simulate(VALUES, voltage(), PERIOD, np.zeros(3))


def test_an_engine_that_writes_into_its_parameters_is_refused():
    """Each step was of another machine, and a prediction was wrong without a word."""

    class Heavier(Engine):
        def advance(self, values, state, voltage, torque, duration):
            values["J"] *= 1.001
            return super().advance(values, state, voltage, torque, duration)

    with pytest.raises(LdtError, match="advance: expected the parameters left as they are"):
        Heavier().simulate(VALUES, voltage(), PERIOD, np.zeros(3))
    assert VALUES["J"] == 1e-3


def test_an_engine_that_fails_names_its_line(tmp_path, monkeypatch):
    """Its file is the user's own, and may be long."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "failing.py").write_text(
        "from ldt_core.physics.motor import Motor\n"
        "from ldt_core.physics.simulator import Simulator\n"
        "class Failing(Simulator):\n"
        "    name, parameters = 'failing', Motor.parameters\n"
        "    def advance(self, values, state, voltage, torque, duration):\n"
        "        return state * values['stiffness']\n"
        "FAILING = Failing()\n"
    )
    physics = PHYSICS.get("failing.py:FAILING")
    with pytest.raises(LdtError, match=r"KeyError: 'stiffness' \(.*failing.py, line 6\)"):
        physics.simulate(VALUES, voltage(), PERIOD, np.zeros(3))


def test_a_physics_that_does_not_bear_an_effect_is_no_end_of_a_diagnosis(monkeypatch):
    """One that takes three states, and is given an effect's beside them."""

    class Narrow(Motor):
        def simulate_all(self, runs, max_step=1e-3, least_step=0.0, workers=1):
            return Physics.simulate_all(self, runs, max_step, least_step, workers)

        def simulate(self, values, voltage, period, initial, *rest, **more):
            _theta, _omega, _current = initial
            return super().simulate(values, voltage, period, initial, *rest, **more)

    narrow = machine(Narrow, monkeypatch)
    plant = Plant(narrow, experiments=3, seed=3, degradation="none", noise=0.05)
    effects = [get_effect("winding_heating"), get_effect("inertia")]
    experiments = [plant.experiment(i).part(0, 120) for i in (1, 2, 3)]
    changed = [replace(e, speed=1.1 * e.speed) for e in experiments]
    found = diagnose(narrow, changed, effects=effects, workers=1)
    assert "winding_heating" not in found.verdict.effects


def test_a_physics_without_the_motors_parameters_is_refused(monkeypatch):
    class Bare(Engine):
        parameters = Motor.parameters[:2]

    with pytest.raises(MachineFileError, match=r"J, K_t, R, L, b.*without R, L, b"):
        machine(Bare, monkeypatch)


def test_whoever_waits_for_a_slow_simulator_is_told_once_how_long(monkeypatch):
    """A diagnosis by an engine in plain Python took half an hour, and nobody said why."""
    told: list[str] = []
    monkeypatch.setattr(slow_runs, "listener", told.append)
    monkeypatch.setattr(slow_runs, "_spent", 0.999 * slow_runs.PATIENCE)
    monkeypatch.setattr(slow_runs, "_count", 140)
    for _ in range(2):
        Engine().simulate(VALUES, voltage(), PERIOD, np.zeros(3))
    assert len(told) == 1
    assert told[0].startswith("a run of the simulator engine takes 0.1")
    assert "ldt docs simulator" in told[0]
