"""Facts of a stream: what is detectable, and what the truth itself leaves."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from scipy import stats

from ldt_core.lab.study.facts import Facts, energy_needed, facts_of, facts_of_plant, stream_key
from ldt_core.lab.study.study_case import StudyCase
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine

SHORT = dataclasses.replace(load_machine("rotor"), duration=4.0)


def examined(**options):
    plant = Plant(SHORT, experiments=12, seed=2, **{"degradation": "abrupt", **options})
    return facts_of_plant(plant, [plant.experiment(n) for n in range(1, 13)], 2)


@pytest.fixture(scope="module")
def jump():
    """One jump from 0 to 12 mm, 4 s an experiment."""
    return examined()


def test_the_true_model_leaves_the_noise_alone(jump):
    """From rest, at 4 s: the floor is the maximum of the noise, and what the first sample adds."""
    noise_alone = 0.1 * 3.18
    assert noise_alone * 0.9 < jump.mme_floor < noise_alone * 1.5


def test_one_experiment_late_costs_the_drifts_first_experiment_alone(jump):
    """All others are as the floor."""
    (drift,) = jump.drifts
    differs = [n for n, (a, b) in enumerate(zip(jump.floor, jump.late, strict=True), 1) if a != b]
    assert differs == [drift.number]
    assert jump.late[drift.number - 1] > 2.0
    assert jump.mme_late > jump.mme_floor


def test_a_drift_is_seen_by_what_it_does_to_the_speed(jump):
    """12 mm show in every respect; the window ends four experiments later or with the run."""
    (drift,) = jump.drifts
    assert (drift.before, drift.after) == (0.0, 0.012)
    assert drift.last == min(drift.number + 4, 12)
    assert drift.detectable
    assert drift.twice
    assert drift.largest > 2.0
    assert jump.detectable == jump.twice == [drift.number]


def test_a_drift_far_below_the_noise_cannot_be_found():
    """12 mm again, but under a noise of 300 rad/s."""
    (drift,) = examined(noise=300.0).drifts
    assert (drift.detectable, drift.twice) == (False, False)


def test_without_noise_everything_shows():
    """0.01 mm."""
    (drift,) = examined(noise=0.0, degradation_to=1e-5).drifts
    assert drift.energy == np.inf
    assert drift.twice


def test_a_window_ends_before_the_next_drift():
    """With a drift in each experiment, a window holds just that one."""
    assert all(d.last == d.number for d in examined(degradation="ramp").drifts)


def test_facts_survive_json(jump):
    """Plain values there and back, also where the energy is infinite."""
    for found in (jump, examined(noise=0.0)):
        assert Facts.from_dict(json.loads(json.dumps(found.to_dict(), allow_nan=False))) == found


def test_cases_on_one_stream_share_its_name():
    """Model and detector do not count, seed and plant do."""
    one = StudyCase("linear", "threshold", 1, settings={"threshold": 5.0})
    assert stream_key(one) == stream_key(StudyCase("hybrid", "periodic", 1, alarms=(3,)))
    others = [StudyCase("linear", "threshold", 2), StudyCase("linear", "threshold", 1, 100)]
    others.append(StudyCase("linear", "threshold", 1, settings={"noise": 0.2}))
    assert len({stream_key(c) for c in [one, *others]}) == 4


def test_a_case_and_its_plant_have_the_same_facts():
    """Settings of the case reach the plant."""
    case = StudyCase("linear", "threshold", 2, 3, settings={"degradation": "none", "noise": 0.2})
    found = facts_of(case)
    assert (found.drifts, found.noise, found.truth) == ((), 0.2, (0.0, 0.0, 0.0))
    assert found.floor == found.late


@pytest.mark.slow
@pytest.mark.parametrize("samples", [50, 2000])
def test_the_energy_test_keeps_its_promise(samples):
    """Against simulation: one false alarm in 1000, nine in ten found, whatever the shape."""
    random = np.random.default_rng(0)
    noise = random.normal(size=(4000, samples))
    limit = stats.chi2.isf(1e-3, samples)
    assert np.mean((noise**2).sum(axis=1) > limit) < 3e-3
    for shape in (np.ones(samples), np.eye(samples)[0]):
        change = shape * np.sqrt(energy_needed(samples) / (shape @ shape))
        assert np.mean(((noise + change) ** 2).sum(axis=1) > limit) == pytest.approx(0.9, abs=0.02)
