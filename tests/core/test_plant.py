"""The plant: what it simulates, and that the same seed always gives the same numbers."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from ldt_core.base.errors import BadInput
from ldt_core.base.settings import resolve
from ldt_core.effects import parse_effect
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine

ROTOR, MOTOR = load_machine("rotor"), load_machine("dc_motor")


def same(one, two):
    np.testing.assert_array_equal(one.voltage, two.voltage)
    np.testing.assert_array_equal(one.speed, two.speed)
    assert (one.number, one.start, one.period) == (two.number, two.start, two.period)


@pytest.mark.parametrize("start", ["rest", "random", "continue"])
def test_a_plant_that_is_restarted_goes_on_with_the_same_numbers(start):
    """Experiments 3, 1, 2, 2 of a new plant are those of one that ran from the first on."""
    first = Plant(ROTOR, experiments=20, seed=5, start=start)
    run = [first.experiment(i) for i in range(1, 5)]
    later = Plant(ROTOR, experiments=20, seed=5, start=start)
    for i in (3, 1, 2, 2, 4):
        same(later.experiment(i), run[i - 1])


@pytest.mark.slow
def test_another_process_gives_the_same_numbers():
    """Bit by bit, compiled code and random streams included."""
    code = (
        "from ldt_core.machine.machine_file import load_machine\n"
        "from ldt_core.machine import Plant\n"
        "import hashlib\n"
        "e = Plant(load_machine('rotor'), experiments=9, seed=4).experiment(8)\n"
        "print(hashlib.sha256(e.speed.tobytes() + e.voltage.tobytes()).hexdigest())"
    )
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)]
    runs.append(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True))
    assert runs[0].returncode == 0, runs[0].stderr
    assert runs[0].stdout == runs[1].stdout


def test_another_seed_or_number_gives_other_numbers():
    """Voltage and noise alike."""
    plant, other = (Plant(ROTOR, degradation="none", seed=s) for s in (1, 2))
    rows = [plant.experiment(1), plant.experiment(2), other.experiment(1)]
    assert len({row.voltage[0] for row in rows}) == 3
    assert len({row.speed[0] for row in rows}) == 3


def test_the_noise_is_white_and_of_the_stated_size():
    """With and without: the difference has the standard deviation and no memory."""
    noisy = Plant(ROTOR, seed=1, noise=0.2, degradation="none").experiment(1)
    clean = Plant(ROTOR, seed=1, noise=0.0, degradation="none").experiment(1)
    noise = noisy.speed - clean.speed
    assert noise.std() == pytest.approx(0.2, rel=0.06)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.08
    assert Plant(ROTOR).noise == 0.1


def test_wear_shows_in_the_truth_and_in_the_speed():
    """The truth follows the staircase; the machine without wear differs once it has risen."""
    worn = Plant(ROTOR, experiments=10, seed=2, noise=0.0)
    new = Plant(ROTOR, experiments=10, seed=2, noise=0.0, degradation="none")
    assert new.truth(10) == {}
    assert worn.truth(1) == {"unbalance": {"e": 0.0}}
    assert worn.truth(10) == {"unbalance": {"e": 0.012}}
    assert np.abs(worn.experiment(1).speed - new.experiment(1).speed).max() < 1e-9
    assert np.abs(worn.experiment(10).speed - new.experiment(10).speed).max() > 1


def test_wear_takes_the_place_of_a_given_value_and_leaves_other_effects():
    """The unbalance from the command line gives way to the staircase; friction stays."""
    effects = [parse_effect("unbalance:e=0.5"), parse_effect("coulomb_friction:torque=0.1")]
    plant = Plant(ROTOR, experiments=10, effects=effects)
    assert plant.truth(10) == {"unbalance": {"e": 0.012}, "coulomb_friction": {"torque": 0.1}}


def test_an_experiment_from_rest_starts_at_rest_and_one_that_continues_does_not():
    """And a random angle changes a run of a rotor with unbalance."""
    quiet = {"noise": 0.0, "degradation": "none", "seed": 3}
    effects = [parse_effect("unbalance")]
    rest = Plant(ROTOR, effects=effects, **quiet).experiment(2)
    turned = Plant(ROTOR, effects=effects, start="random", **quiet).experiment(2)
    going = Plant(ROTOR, effects=effects, start="continue", **quiet)
    first, second = going.experiment(1), going.experiment(2)
    assert rest.speed[0] == turned.speed[0] == 0
    assert np.abs(rest.speed - turned.speed).max() > 1e-3
    assert second.speed[0] == pytest.approx(first.speed[-1], abs=0.5)
    assert second.speed[0] != first.speed[-1]
    assert second.start == pytest.approx(first.end)


def test_states_of_effects_go_on_as_well():
    """A winding that is warm at the end of an experiment is warm at the start of the next."""
    effects = [parse_effect("winding_heating:thermal_resistance=100,time_constant=1000")]
    kept = {"effects": effects, "noise": 0.0, "degradation": "none", "seed": 3}
    cold = Plant(MOTOR, **kept).experiment(5)
    warm = Plant(MOTOR, start="continue", **kept).experiment(5)
    assert np.array_equal(cold.voltage, warm.voltage)
    assert warm.speed[-1] < cold.speed[-1]


def test_settings_override_the_machine_file_and_their_defaults_do_not():
    """Defaults of parameters.yaml mean the file; given values win."""
    plain = Plant.from_settings(ROTOR, resolve({}, "plant", "run"))
    assert (plain.noise, plain.start, plain.schedule.kind) == (0.1, "rest", "staircase")
    assert plain.schedule.end == 0.012
    assert plain.start_time > 1.7e9
    given = {
        "noise": 0.0,
        "start": "random",
        "degradation": "ramp",
        "degradation_to": 0.004,
        "voltage": "constant",
        "start_time": 100.0,
        "measure_current": True,
        "effect": ["coulomb_friction:torque=0.1"],
        "experiments": 5,
    }
    plant = Plant.from_settings(ROTOR, resolve(given, "plant", "run"))
    experiment = plant.experiment(3)
    assert np.ptp(experiment.voltage) == 0
    assert experiment.start == 140.0
    assert experiment.current is not None
    assert plant.truth(3)["unbalance"]["e"] == pytest.approx(0.002)
    assert plant.describe() == [
        "coulomb_friction:torque=0.1",
        "ramp of unbalance.e from 0 to 0.004",
        "noise 0 rad/s",
    ]


def test_the_current_is_that_of_the_motor():
    """In steady running K_t i = b w; without noise unless the file has some."""
    plant = Plant(ROTOR, noise=0.0, voltage="constant", degradation="none", measure_current=True)
    e = plant.experiment(1)
    assert e.current[-1] == pytest.approx(0.01 * e.speed[-1] / 0.3, rel=1e-6)
    noisy = replace(ROTOR, simulation={**ROTOR.simulation, "current_noise": 0.05})
    kept = {"noise": 0.0, "voltage": "constant", "degradation": "none"}
    noise = Plant(noisy, measure_current=True, **kept).experiment(1).current - e.current
    assert noise.std() == pytest.approx(0.05, rel=0.06)


@pytest.mark.parametrize(
    ("machine", "simulation", "options", "words"),
    [
        (ROTOR, {"noize": 1}, {}, "simulation: expected one of .*unknown key 'noize'"),
        (ROTOR, {"noise": -1}, {}, "simulation.noise: expected a standard deviation"),
        (ROTOR, {"noise": "loud"}, {}, "simulation.noise: expected a number"),
        (ROTOR, {"start": "rset"}, {}, "simulation.start: .*did you mean 'rest'"),
        (ROTOR, {"voltage": [6, 16]}, {}, "names with values"),
        (ROTOR, {"degradation": "staircase"}, {}, "names with values"),
        (MOTOR, {}, {"effects": [parse_effect("unbalance")]}, "a machine with parameter e"),
        (
            MOTOR,
            {"degradation": {"effect": "unbalance", "parameter": "e", "to": 0.01}},
            {},
            "a machine with parameter e",
        ),
    ],
)
def test_what_cannot_be_simulated_is_refused_before_the_first_experiment(
    machine, simulation, options, words
):
    """Unknown keys, impossible values, effects of another machine."""
    with pytest.raises(BadInput, match=words):
        Plant(replace(machine, simulation=simulation), **options)
