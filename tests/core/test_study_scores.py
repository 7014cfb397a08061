"""Scores of a run, on streams whose answer is known by hand."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from study_results import made_up

from ldt_core.lab.study.drift_detection import delays, detection
from ldt_core.lab.study.facts import Drift, Facts
from ldt_core.lab.study.scores import chance, in_windows, scores_of

# Twenty experiments; the value changes at 6 and at 16.
TRUTH = [0.0] * 5 + [1.0] * 10 + [2.0] * 5


def facts(detectable):
    """Facts of TRUTH in which only these drifts can be found; floor 0.5, one late 1."""
    drifts = tuple(
        Drift(n, n + 4, before, after, 1.0, 1.0, n in detectable, False)
        for n, before, after in ((6, 0.0, 1.0), (16, 1.0, 2.0))
    )
    return Facts(0, 0.1, tuple(TRUTH), (0.5,) * 20, (1.0,) * 20, drifts)


def test_a_run_by_hand():
    """Positives at 3 (false), 7 (drift of 6, one late), 8 (again), 14 (false): all counted."""
    errors = [2.0] * 10 + [4.0] * 10
    run = made_up(TRUTH, [3, 7, 8, 14], adapted=[7, 14], max_error=errors, original=6.0)
    found = scores_of(run, facts(detectable=[6]))
    assert (found.mme, found.mme_original, found.share) == (3.0, 6.0, 0.5)
    assert (found.positives, found.adaptations, found.refusals) == (4, 2, 2)
    assert (found.drifts, found.detected, found.recall, found.precision) == (2, 1, 0.5, 0.25)
    assert (found.detectable, found.detected_detectable, found.recall_detectable) == (1, 1, 1.0)
    assert found.delay == 2.0
    assert (found.false_alarms, found.outside, found.false_alarm_rate) == (2, 10, 0.2)
    assert (found.over_floor, found.over_late) == (6.0, 3.0)
    assert set(found.as_dict()) >= {"mme", "chance_recall", "chance_precision"}


def test_what_is_undefined_is_none():
    """No drifts, no positives, no facts."""
    found = scores_of(made_up([0.0] * 4))
    undefined = ("recall", "precision", "chance_recall", "chance_precision", "delay")
    undefined += ("detectable", "detected_detectable", "recall_detectable")
    undefined += ("over_floor", "over_late")
    assert {name: getattr(found, name) for name in undefined} == dict.fromkeys(undefined)
    assert (found.false_alarms, found.outside, found.false_alarm_rate) == (0, 4, 0.0)


def test_an_alarm_in_a_window_is_no_false_alarm_although_it_reveals_nothing():
    """Precision blames the second positive after a drift, the false-alarm rate does not."""
    found = scores_of(made_up(TRUTH, [6, 7]))
    assert (found.precision, found.false_alarms) == (0.5, 0)


def test_delays_count_the_drifts_own_experiment_as_one():
    """At once is 1, the last of the window 5; a drift without a positive in it has none."""
    assert delays([6, 16], [6, 20]) == {6: 1, 16: 5}
    assert delays([6], [5, 11]) == {}


def test_windows_end_with_the_run():
    """The window of a late drift is cut, and windows may overlap."""
    assert in_windows([18, 19], range(1, 21)) == {18, 19, 20}


@pytest.mark.parametrize("drifts", [[3], [3, 5], [1, 2, 9], [10], [2, 3, 4]])
@pytest.mark.parametrize("alarms", [1, 2, 4, 9, 10])
def test_chance_is_the_mean_over_all_draws(drifts, alarms):
    """The formula against every possible draw, one by one."""
    numbers = range(1, 11)
    every = [detection(drifts, draw) for draw in itertools.combinations(numbers, alarms)]
    expected = np.mean([d.recall for d in every]), np.mean([d.precision for d in every])
    assert chance(drifts, alarms, numbers) == pytest.approx(expected, abs=1e-12)


@given(st.sets(st.integers(2, 200), min_size=1, max_size=15), st.integers(1, 200))
def test_chance_is_a_probability(drifts, alarms):
    """Whatever the drifts and the number of alarms."""
    recall, precision = chance(sorted(drifts), alarms, range(1, 201))
    assert 0 <= recall <= 1
    assert 0 <= precision <= 1
    assert precision * alarms <= len(drifts) * recall + 1e-9


def test_the_papers_figures_are_below_chance():
    """Nine drifts: 25 random alarms reach recall 0.49, precision 0.18; 44 reach 0.71 and 0.15."""
    drifts = range(20, 200, 20)
    assert chance(drifts, 25, range(1, 201)) == pytest.approx((0.49, 0.18), abs=0.006)
    assert chance(drifts, 44, range(1, 201)) == pytest.approx((0.71, 0.15), abs=0.006)
