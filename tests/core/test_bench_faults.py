"""The default twin on a motor that is recorded with the faults of a test bench."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from ldt_core.base.pausable import finished
from ldt_core.effects import get_effect
from ldt_core.estimation.grey_box import GreyBox, Prior
from ldt_core.estimation.structure_screening import Present
from ldt_core.models.grey_box import GreyBoxModel
from tests.bench_faults import (
    CHANGES,
    EXPERIMENTS,
    FAULTS,
    after_the_change,
    experiments,
    motor_on_a_bench,
)

pytestmark = pytest.mark.usefixtures("one_core")

HALF = EXPERIMENTS // 2


@functools.cache
def plainly(change):
    """What is recorded without a fault, of the first seed."""
    return experiments("none", change, 1)


@pytest.mark.slow
@pytest.mark.parametrize("change", CHANGES)
def test_the_motor_changes_half_way(change):
    """Not before; and the same voltages move it otherwise after that."""
    same, changed = plainly("gravity"), plainly(change)
    if change != "again":
        assert all(
            np.array_equal(a.speed, b.speed) for a, b in zip(same[:HALF], changed, strict=False)
        )
    if change == "again":
        again = experiments("none", change, 1)
        assert all(np.array_equal(a.speed, b.speed) for a, b in zip(again, changed, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("fault", [f for f in FAULTS if f != "none"])
def test_a_fault_shows_from_the_first_experiment_on(fault):
    """In the voltage or in the speed, by more than another draw of the noise."""
    (plain, *_), (shown, *_) = plainly("dry"), experiments(fault, "dry", 1)
    moved = np.abs(shown.speed - plain.speed).max() + np.abs(shown.voltage - plain.voltage).max()
    assert moved > 0.2


@pytest.mark.slow
@pytest.mark.parametrize(("change", "most", "seed"), [("gravity", 0.05, 1), ("cubic", 0.17, 3)])
def test_behind_a_sensors_filter_what_changes_is_learned(change, most, seed):
    """No cause of one experiment replaces what was right before.

    Of a drag without a law several models come and go. Which ones do depends on the seed, and on a
    processor's rounding: of seed 1, 15 % is left on one and 21 % on another; of this one 9 %.
    """
    twin, original = after_the_change("filter", change, seed)
    assert twin < most * original


@pytest.mark.slow
def test_what_an_experiment_does_not_tell_stays_where_it_is_expected():
    """Friction backward, of a shaft that turns forward alone; noise asked for 0.3 N m."""
    e = experiments("load", "again", seed=1)[19]
    assert e.speed.min() > -1.0
    friction = get_effect("asymmetric_friction")
    model = GreyBoxModel(motor_on_a_bench())
    for expected in ({}, {"torque_forward": 0.02, "torque_backward": 0.03}):
        given = {friction.name: friction.check(expected)}
        search = model.search_on([e])
        box = GreyBox(model.machine, (friction,), model.machine.tolerances)
        near = box.coordinates(given, np.zeros(len(box.uncertain))) if expected else None
        present = Present((), {}, Prior.apart(len(box.uncertain)))
        found = finished(search.fitted(present, (friction,), near))
        ((_, amounts),) = found.box.values(found.fit.q)[1]
        assert 0.015 < amounts["torque_forward"] < 0.025
        assert abs(amounts["torque_backward"] - expected.get("torque_backward", 0.0)) < 0.01
