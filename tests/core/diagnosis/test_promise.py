"""Claims about promises: kept where what was seen decides, refused where it does not."""

from __future__ import annotations

import numpy as np
import pytest
from recorded_machines import MOTOR, NOISE, record

from ldt_core.base.errors import BadInput
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.holdout import free_run
from ldt_core.diagnosis.promise import determined, further_interval, promised
from ldt_core.effects import get_effect

FRICTION = "coulomb_friction:torque=0.01"
NAMES = ("coulomb_friction", "constant_load", "inertia")
FORWARD, BOTH, FAST = (4.0, 12.0), (-12.0, 12.0), (20.0, 24.0)  # V


def found(volts):
    """The keys of a diagnosis of dry friction, by voltages of this range."""
    tried = [get_effect(name) for name in NAMES]
    recording = record(MOTOR, FRICTION, count=4, volts=volts)
    return diagnose(MOTOR, recording, effects=tried, workers=1).as_dict()


@pytest.fixture(scope="module")
def forward():
    return found(FORWARD)


@pytest.fixture(scope="module")
def reversing():
    return found(BOTH)


def realised(content, experiments):
    """Closed fraction of the gap of experiments, against the noise."""
    use = [(get_effect(e["effect"]), e["parameters"]) for e in content["effects"]]
    before, after = (
        sum(float(np.sum((e.speed - free_run(MOTOR, e, u)) ** 2)) for e in experiments)
        for u in ((), use)
    )
    return (before - after) / (before - NOISE**2 * sum(map(len, experiments)))


def test_more_of_the_same_is_promised_and_comes_true(forward, reversing):
    """Though what was found is a group: all of it does the same there."""
    for content, volts in ((forward, FORWARD), (reversing, BOTH)):
        further = record(MOTOR, FRICTION, count=3, volts=volts)
        of = promised(MOTOR, content, further)
        assert not of.refused
        assert realised(content, further) == pytest.approx(of.closed_fraction, abs=0.05)
        assert of.interval[0] <= of.closed_fraction <= of.interval[1]


def test_a_file_with_the_keys_of_the_verdict_alone_is_as_good(reversing):
    """`effects` is for programs; a number that no float holds is as good as none."""
    bare = {key: value for key, value in reversing.items() if key != "effects"}
    further = record(MOTOR, FRICTION, count=3, volts=BOTH)
    assert promised(MOTOR, bare, further).as_dict() == promised(MOTOR, reversing, further).as_dict()
    huge = {**reversing, "gap": {**reversing["gap"], "closed_fraction": 10**400}}
    assert promised(MOTOR, huge, further).closed_fraction is None


def test_nothing_is_promised_where_those_that_look_alike_differ(forward):
    """A load that pulls one way, and a friction that turns with the motion."""
    assert forward["verdict"]["kind"] == "ambiguous"
    of = promised(MOTOR, forward, record(MOTOR, FRICTION, count=3, volts=BOTH))
    assert of.closed_fraction is None
    assert "could not tell from it" in of.refused


def test_nothing_is_promised_beyond_the_speeds_that_were_seen(forward, reversing):
    """Backward for the first time, or more than twice as fast."""
    alone = {**forward, "alternatives": []}
    of = promised(MOTOR, alone, record(MOTOR, FRICTION, count=3, volts=BOTH))
    assert of.closed_fraction is None
    assert "backward" in of.refused
    assert "no motion was recorded" in of.refused
    slow = {**reversing, "seen": {"speed": [v / 4 for v in reversing["seen"]["speed"]]}}
    assert "forward" in promised(MOTOR, slow, record(MOTOR, FRICTION, volts=FAST)).refused


def test_what_differs_from_experiment_to_experiment_is_no_number():
    """One that is held out closes all of its gap, and others half: half to all is said."""
    recording = record(MOTOR, count=8)
    before = [e.speed + 1.0 for e in recording]
    after = [e.speed + (0.7 if k % 2 else 0.0) for k, e in enumerate(recording)]
    ends = further_interval(1.0, recording, before, after, 0.0, 2, 0)
    assert ends == pytest.approx((0.51, 1.0))
    assert determined(1.0, ends) is None
    alike = further_interval(0.98, recording, before, [e.speed + 0.1 for e in recording], 0.0, 2, 0)
    assert determined(0.98, alike) == 0.98
    assert determined(None, None) is None


def test_the_sentence_says_the_range_where_there_is_no_number(reversing):
    """And no promise is made."""
    gap = {**reversing["gap"], "closed_fraction": None, "closed_fraction_ci95": [0.5, 1.0]}
    of = promised(MOTOR, {**reversing, "gap": gap}, record(MOTOR, FRICTION, volts=BOTH))
    assert "differs from experiment to experiment" in of.refused


def test_a_foreign_file_promises_nothing_or_is_refused(reversing):
    """Whatever stands where numbers and effects should."""
    recording = record(MOTOR, FRICTION, volts=BOTH)
    for junk in (None, [], "x", 3, {"speed": "x"}, {"speed": [1]}, {"speed": [None, None]}):
        assert not promised(MOTOR, {**reversing, "seen": junk}, recording).refused
        assert promised(MOTOR, {**reversing, "gap": junk}, recording).refused
    for junk in ([3], [[{"effect": "inertia"}]], [[{"effect": "none", "parameters": {"a": 1}}]]):
        with pytest.raises(BadInput):
            promised(MOTOR, {**reversing, "alternatives": junk}, recording)
