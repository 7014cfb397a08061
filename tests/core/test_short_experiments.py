"""Experiments of few samples: what they do not tell is said, and they are learned from together."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import ldt_core as ldt
from ldt_core.detectors.adequacy import Adequacy
from ldt_core.machine.plant import Plant

LENGTHS = (20, 30, 50, 100)


def left(kind, length, random):
    """A slow error of a root mean square of three deviations of the noise."""
    time = np.linspace(0, 1, length)
    shapes = {
        "offset": np.ones(length),
        "wave": np.sin(2 * np.pi * (time + random.random())),
        "fades": np.exp(-4 * time),
        "grows": time,
    }
    return 3 * shapes[kind] / np.sqrt(np.mean(shapes[kind] ** 2))


def states(length, error, count=300):
    """What is known after a first experiment with this error(random), each time anew."""
    random, found = np.random.default_rng(length), []
    for _ in range(count):
        detector = Adequacy()
        detector.excited(np.full(length, random.uniform(-12, 12)))
        detector.update(random.normal(size=length) + error(random))
        found.append(detector.model_state)
    return found


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("kind", ["offset", "wave", "fades", "grows"])
def test_no_model_that_errs_by_three_deviations_holds(kind, length):
    """However few the samples: the state is that too little is known, at least."""
    assert "holds" not in states(length, lambda random: left(kind, length, random))


@pytest.mark.parametrize("length", LENGTHS)
def test_a_true_model_holds_in_nearly_all_experiments(length):
    """In nine of ten, of 20 samples; in more, of more."""
    shown = states(length, lambda random: 0.0).count("holds") / 300
    assert shown > 1 - 2 / length


@pytest.mark.slow
@pytest.mark.parametrize("samples", [20, 50])
def test_what_few_samples_do_not_tell_several_experiments_do(samples):
    """Dry friction begins: it is found as soon as some 100 samples show it, at the first attempt.

    Nothing that was fitted to fewer comes into force before.
    """
    known = ldt.Machine("dc_motor")
    worn = {"kind": "abrupt", "effect": "coulomb_friction", "parameter": "torque", "to": 0.1}
    voltage = {**known.simulation["voltage"], "low": -12.0, "hold": 0.1}
    simulation = {**known.simulation, "voltage": voltage, "degradation": worn}
    short = dataclasses.replace(
        known, duration=samples * known.sample_period, simulation=simulation
    )
    plant = Plant(short, experiments=30, seed=3)
    (change,) = plant.schedule.changes
    twin = ldt.Twin(short)
    steps = [twin.step(plant.experiment(i)) for i in range(1, 31)]
    (learned,) = (s.number for s in steps if s.adaptation.action == "adapted")
    assert 100 <= (learned - change + 1) * samples <= 100 + samples
    assert "coulomb friction" in steps[learned - 1].adaptation.reason
    later = [s for s in steps if s.number > learned]
    assert len(later) >= 4
    for s in later:
        assert s.signal.adequacy < 1.6
