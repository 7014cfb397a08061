"""Recordings whose times are wrong, and ones that show no motion: no cause is named for sure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded_machines import MOTOR, NOISE, PERIOD, record

from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.recorded_times import without_repeats
from ldt_core.effects import get_effect

TRIED = [
    get_effect(n)
    for n in ("inertia", "input_delay", "sensor_lag", "armature_resistance", "constant_load")
]


@pytest.fixture(scope="module")
def healthy():
    return record(MOTOR, count=4)


def repeated(e, times, shift=0):
    """The experiment with each sample several times, from within the first one's."""
    rows = [np.repeat(x, times)[shift:] for x in (e.voltage, e.speed)]
    return Experiment(e.number, e.start, e.period / times, *rows)


@pytest.mark.parametrize("shift", [0, 1])
@pytest.mark.parametrize("times", [2, 5])
def test_samples_that_repeat_count_once(healthy, times, shift):
    """A held speed comes late by half the time that it is held: that was an input delay."""
    found = diagnose(MOTOR, [repeated(e, times, shift) for e in healthy], effects=TRIED, workers=1)
    assert found.verdict.kind == "none"
    assert any(f"{times} times" in note for note in found.notes)


def test_what_is_there_once_is_left_as_it_is(healthy):
    """Also a coarse sensor, a few samples that happen to be alike, and one held for a while."""
    coarse = [replace(e, speed=np.round(e.speed)) for e in healthy]
    held = [replace(e, speed=np.repeat(e.speed[::2], 2), voltage=e.speed) for e in healthy]
    still = [replace(e, speed=np.zeros(len(e))) for e in healthy]
    for given in (healthy, coarse, held, still):
        kept, note = without_repeats(given)
        assert not note
        assert all(a is b for a, b in zip(kept, given, strict=True))


@pytest.mark.parametrize("factor", [0.1, 2.0, 10.0])
@pytest.mark.slow
def test_a_period_that_is_wrong_is_told_of(healthy, factor):
    """It is one more explanation of what looks like an inertia, or like nothing known."""
    found = diagnose(
        MOTOR, [replace(e, period=factor * e.period) for e in healthy], effects=TRIED, workers=1
    )
    assert any(f"period {1 / factor:.2g}" in note for note in found.notes), found.notes


def test_a_load_is_no_wrong_clock():
    """No period explains it."""
    found = diagnose(
        MOTOR, record(MOTOR, "constant_load:torque=0.02", count=4), effects=TRIED, workers=1
    )
    assert found.verdict.effects == ["constant_load"]
    assert not any("period" in note for note in found.notes)


@pytest.mark.parametrize("noise", [0.0, NOISE])
def test_one_constant_speed_names_no_cause(noise):
    """Anything that changes the speed explains it: seven effects did, as sure as it gets."""
    random = np.random.default_rng(1)
    given = [
        Experiment(k + 1, 20.0 * k, PERIOD, np.full(500, 8.0), 20.0 + noise * z)
        for k, z in enumerate(random.standard_normal((4, 500)))
    ]
    found = diagnose(MOTOR, given, effects=TRIED, workers=1)
    assert found.verdict.kind == "unknown"
    assert "where a constant speed leaves" in found.verdict.sentence


def test_a_speed_that_is_counted_over_each_sample_is_told():
    """An encoder's pulses give the mean speed of the sample before: a delay of half of it."""
    finer, random = 20, np.random.default_rng(5)
    counted = []
    for e in record(MOTOR, count=4):
        volts = np.repeat(e.voltage, finer)
        states = MOTOR.model.simulate(MOTOR.parameters, volts, PERIOD / finer, np.zeros(3))
        turned = states[::finer, 0]
        speed = np.diff(turned, prepend=0.0) / PERIOD + random.normal(0, NOISE, len(e))
        counted.append(replace(e, speed=speed))
    found = diagnose(MOTOR, counted, effects=TRIED, workers=1)
    assert found.verdict.acting[0][0] == "input_delay"
    assert any("the delay is half a sample (0.005 s)" in note for note in found.notes)
    delayed = record(MOTOR, "input_delay:delay=0.02", count=4)
    found = diagnose(MOTOR, delayed, effects=TRIED, workers=1)
    assert found.verdict.acting == [["input_delay"]]
    assert not any("half a sample" in note for note in found.notes)
