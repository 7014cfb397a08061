"""The streams of the group robustness: what they promise, and what their references know."""

import numpy as np
import pytest

from ldt_core.lab.study.robustness.streams import FOUNDATION, STREAMS
from ldt_core.lab.study.robustness.true_plant import ChallengePlant, LibraryPlant
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.models.physics import PhysicsModel

FEW = 8


def test_the_staircase_is_that_of_the_command():
    """`ldt run --experiments 40 --seed 3` has the same numbers, to the last bit."""
    given = STREAMS["staircase"](3)
    plant = Plant(load_machine("rotor"), experiments=40, seed=3)
    assert len(given.experiments) == 40
    for experiment in given.experiments:
        same = plant.experiment(experiment.number)
        assert np.array_equal(same.voltage, experiment.voltage)
        assert np.array_equal(same.speed, experiment.speed)
    assert given.changes == plant.schedule.changes


@pytest.mark.parametrize("name", STREAMS)
@pytest.mark.slow
def test_the_references_know_the_truth(name):
    """The true parameters leave the noise; one experiment late is worse where something changes."""
    given = STREAMS[name](1, FEW)
    known, late = given.references.known, given.references.late
    if not given.random_start:  # whose angle nobody knows
        assert np.mean(known) < 5 * given.noise
    for number in range(1, FEW + 1):
        if number not in given.changes:
            # In the first, the file's physics stands in for another simulator's.
            assert late[number - 1] == pytest.approx(known[number - 1], abs=1e-4)
    if len(given.changes) > 1:
        assert np.mean(late) > np.mean(known)


@pytest.mark.parametrize("name", STREAMS)
def test_a_stream_is_its_seed_s(name):
    """The same seed gives the same numbers, another one others."""
    kind = STREAMS[name]
    first, again, other = (kind(seed, 2).experiments[1] for seed in (1, 1, 2))
    assert np.array_equal(first.speed, again.speed)
    assert not np.array_equal(first.speed, other.speed)


def test_where_nothing_changes_the_file_is_right():
    """The quiet stream's machine is its file, to the noise, and has no change."""
    given = STREAMS["quiet"](1, FEW)
    model = PhysicsModel(given.machine)
    worst = max(model.predict(e).max_error(e) for e in given.experiments)
    assert given.changes == []
    assert worst < 5 * given.noise


def test_a_fast_change_is_about_every_second_experiment():
    """30 changes of 60 experiments."""
    assert len(STREAMS["recurring_fast"](1).changes) == 30


def test_the_constant_voltage_is_the_same_for_30_experiments():
    """And then come steps, of the same machine."""
    given = STREAMS["constant_first"](1)
    assert len({float(v) for e in given.experiments[:30] for v in e.voltage}) == 1
    assert all(len(set(e.voltage.tolist())) == 20 for e in given.experiments[30:])
    assert given.changes == [1]


@pytest.mark.parametrize(("share", "name"), [(0.05, "foundation_5_e6"), (0.1, "foundation_10_e6")])
def test_the_file_s_foundation_is_off_by_its_share(share, name):
    """Up or down, and all else is right."""
    true = load_machine("rotor").parameters
    given = STREAMS[name](1, 1).machine.parameters
    off = {n: abs(given[n] / value - 1) for n, value in true.items() if value}
    assert off == pytest.approx({n: share if n in FOUNDATION else 0.0 for n in off})


def test_both_simulators_are_the_same_machine():
    """Without a law they agree to a thousandth of the noise."""
    machine, volts = load_machine("dc_motor"), np.repeat([4.0, 12.0], 500)
    speeds = [kind(machine, 1).speed((), volts) for kind in (LibraryPlant, ChallengePlant)]
    assert np.abs(speeds[0] - speeds[1]).max() < 1e-4
