"""Claims about the sensor check: a machine that has changed is learned from, however much."""

from __future__ import annotations

import math
from dataclasses import replace

import faulty_sensors as sensors
import numpy as np
import pytest
from faulty_sensors import SHORT, made

from ldt_core.base.experiment import DOUBTFUL, Action
from ldt_core.base.metrics import Summary
from ldt_core.base.settings import resolve
from ldt_core.effects import parse_effect
from ldt_core.machine.machine_file import load_machine
from ldt_core.machine.plant import Plant
from ldt_core.machine.sensor_check import doubt, fault
from ldt_core.twin.loop import Twin

MOTOR = load_machine("dc_motor")


@pytest.mark.parametrize("machine", [SHORT, MOTOR], ids=["rotor", "motor"])
@pytest.mark.parametrize("factor", [0.1, 0.3, 3.0, 10.0])
@pytest.mark.parametrize("name", ["K_t", "R", "J"])
def test_no_size_of_a_parameter_is_taken_for_a_faulty_sensor(machine, name, factor):
    """With and without sound experiments before, sampled slowly and quickly, however driven."""
    changed = {name: factor * machine.parameters[name]}
    for period in (0.02, 0.002):
        sampled = replace(machine, sample_period=period, duration=2.0)
        before = made(3, 1, [], sampled)
        for voltage in ("steps", "chirp", "constant"):
            e = made(1, 2, [], sampled.with_parameters(**changed), voltage=voltage)[0]
            assert fault(sampled, e, before) == ""
            assert fault(sampled, e) == ""


def test_a_machine_that_is_much_faster_than_its_file_is_learned_from_with_a_warning():
    """The word of the contract stays; reason, details and summary tell the doubt."""
    quick = SHORT.with_parameters(K_t=0.03, b=1e-4, J=0.001)
    experiments = made(6, 3, [], quick)
    settings = resolve({"model": "linear", "order": 1, "threshold": 1.0, "gate": "none"})
    steps = list(Twin.from_settings(SHORT, settings).steps(experiments))
    assert any(s.adaptation.action is Action.ADAPTED for s in steps)
    doubtful = [s for s in steps if s.adaptation.details.get(DOUBTFUL)]
    assert doubtful
    told = Summary()
    for step in steps:
        told.add(step)
    words = doubt(SHORT, doubtful[0].experiment)
    assert "by the machine file" in words
    assert doubtful[0].adaptation.reason.endswith(words)
    assert [n for n in told.notes if words in n]


@pytest.mark.parametrize("machine", [SHORT, MOTOR], ids=["rotor", "motor"])
def test_a_speed_in_a_unit_too_small_is_doubted_and_a_slow_machine_is_not(machine):
    """By a thousand and a million; one of a tenth of the speed, or hardly driven, is believed."""
    e = made(1, 3, [], machine)[0]
    for factor in (1e-3, 1e-6):
        assert "another unit, or blocked" in doubt(machine, sensors.shown(e, factor * e.speed))
    assert doubt(machine, e) == ""
    assert doubt(machine, sensors.shown(e, 0.1 * e.speed)) == ""
    held = replace(e, voltage=0.1 * e.voltage, speed=1e-3 * e.speed)
    assert doubt(machine, held) == ""


def test_a_rotor_that_jams_in_one_sample_is_believed():
    """Friction without bound stops it; only its sudden return gives a sensor away."""
    e = made(1)[0]
    here, back = np.arange(len(e)) >= 150, np.arange(len(e)) >= 160
    noise = np.random.default_rng(1).normal(0, 0.1, len(e))
    assert fault(SHORT, sensors.shown(e, np.where(here, noise, e.speed))) == ""
    dropped = np.where(here & ~back, noise, e.speed)
    assert "comes back as suddenly" in fault(SHORT, sensors.shown(e, dropped))


def test_noise_with_long_tails_is_no_fault():
    """Student's t with 3 degrees of freedom, ten times the usual size."""
    for e in made(8, noise=0.0):
        tails = np.random.default_rng(e.number).standard_t(3, len(e)) * 1.0
        assert fault(SHORT, sensors.shown(e, e.speed + tails)) == ""


@pytest.mark.slow
@pytest.mark.parametrize("factor", [60 / (2 * math.pi), 180 / math.pi, 1 / (2 * math.pi)])
def test_a_speed_in_another_unit_from_some_day_on_is_learned_at_once(factor):
    """Somebody set the display to rpm; an observer that took it for rad/s diverged."""
    plant = Plant(load_machine("dc_motor"), experiments=7, seed=1, degradation="none")
    twin = Twin.from_settings(load_machine("dc_motor"), {**resolve({}), "model": "auto"})
    for i in range(1, 8):
        e = plant.experiment(i)
        step = twin.step(replace(e, speed=factor * e.speed) if i > 5 else e)
        if i == 6:
            assert "sensor gain" in step.adaptation.reason
    assert step.signal.state == "holds"
    assert step.signal.max_error < 0.01 * step.original.max_error(step.experiment)


@pytest.mark.parametrize("name", ["sensor_gain:factor=30", "sensor_bias:bias=3", "sensor_lag"])
def test_what_a_sensor_shows_is_looked_through(name):
    """Its own speed comes back, however much larger it is shown."""
    physics, period = load_machine("dc_motor").model, 0.01
    use = [parse_effect(name)]
    speed = 100 * np.sin(np.arange(400) * period)
    states = np.zeros((400, len(physics.states)))
    states[:, 1] = speed
    seen = physics.behind_sensor(physics.measure(states, period, use), period, use)
    np.testing.assert_allclose(seen[20:], speed[20:], atol=0.5)


def test_a_speed_far_rougher_than_the_file_knows_is_told():
    """A ripple above half the sample rate is noise to a model that knows nothing of it."""
    machine = load_machine("dc_motor")
    machine = replace(machine, calibration={"noise": {"speed": 0.05}})
    plant = Plant(machine, experiments=4, seed=1, degradation="none")
    twin = Twin.from_settings(machine, {**resolve({}), "model": "auto"})
    random = np.random.default_rng(0)
    for i in range(1, 5):
        e = plant.experiment(i)
        rough = replace(e, speed=e.speed + 0.8 * random.standard_normal(len(e)))
        step = twin.step(rough if i == 4 else e)
        assert (DOUBTFUL in step.adaptation.details) == (i == 4)
    assert step.signal.state == "holds"
    assert "a noise of 0.8" in step.adaptation.reason
