"""The conditions that a machine was in, and which one may come next."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.base.experiment import Experiment
from ldt_core.machine.machine_file import load_machine
from ldt_core.models.physics import PhysicsModel
from ldt_core.twin.condition_chain import ConditionChain


def experiment(number):
    return Experiment(number, float(number), 0.01, np.ones(4), np.ones(4))


def chain_of(path):
    chain = ConditionChain()
    for number, condition in enumerate(path, start=1):
        chain.saw(condition, experiment(number))
    return chain


def test_without_evidence_a_condition_lasts():
    """A machine that changed once is taken to stay so."""
    assert chain_of([0, 0, 1]).following(1)[1] > 0.9


def test_a_machine_that_goes_back_at_once_each_time_is_expected_to():
    """Condition 1 was left whenever it came."""
    following = chain_of([0, 1, 0, 1, 0, 1, 0, 1]).following(1)
    assert following[0] > 0.5 > following[1]


def test_who_follows_a_coin_should_know_that_it_pays():
    """Left about as often as it stayed, a condition is expected as often as it came, not longer."""
    path = [1, 1, 0, 0, 1, 1, 0, 0, 1, 1, 0, 1, 0]
    assert chain_of(path).following(1)[1] == pytest.approx(np.mean([*path, 1]))
    assert chain_of([0, 1, 1, 1, 1, 0, 0, 1]).following(1)[1] > 0.5


def test_the_benefit_of_the_doubt_is_the_originals():
    """Of two conditions alike, that of the original is taken to last longer."""
    lengths = 1, 4, 4, 1, 2, 5, 5, 2, 1  # of stays in the one and the other by turns
    chain = chain_of([i % 2 for i, length in enumerate(lengths) for _ in range(length)])
    assert chain.following(0)[0] > chain.following(1)[1] + 0.1


@pytest.mark.parametrize(
    "turns", [[1, 2], [1, 1, 2], [1, 1, 2, 2], [0, 0, 1, 1], [1, 2, 3], [1] * 5 + [2] * 5]
)
def test_turns_are_foreseen_of_whatever_length(turns):
    """From the fifth on; each time what comes is the likeliest."""
    path = turns * 10
    for number in range(5 * len(turns), len(path) - 1):
        following = chain_of(path[:number]).following(path[number])
        assert max(following, key=following.get) == path[number + 1]


def test_a_coin_has_no_turns():
    """What came by chance tells nothing of what will: the shortest memory is the best."""
    random = np.random.default_rng(0)
    for _ in range(20):
        path = random.integers(0, 2, 60).tolist()
        following = chain_of(path).following(path[-1])
        assert max(following.values()) < 0.8


def test_what_no_version_explains_is_to_be_expected_again():
    """Each version errs in it as in the newest such experiment."""
    chain = chain_of([1, None] * 5)
    assert chain.following(1)[None] > 0.5
    assert chain.shown[None].number == 10


def test_where_nothing_tells_the_next_one_the_frequencies_do():
    """Of three conditions at random, each is expected as often as it came, wherever one is."""
    random = np.random.default_rng(3)
    for _ in range(10):
        path = random.choice(3, 90, p=[0.5, 0.3, 0.2]).tolist()
        chain = chain_of(path)
        for here in range(3):
            following = chain.following(here)
            for c, share in enumerate((0.5, 0.3, 0.2)):
                assert following[c] == pytest.approx(share, abs=0.2)


@given(path=st.lists(st.sampled_from([None, 0, 1, 2]), max_size=150))
def test_probabilities_sum_to_one_and_all_conditions_are_shown(path):
    """Every condition that may follow has an experiment to compare by."""
    chain = chain_of(path)
    for condition in {c for c in chain.path if c is not None}:
        following = chain.following(condition)
        assert sum(following.values()) == pytest.approx(1.0)
        assert set(following) - {condition} <= set(chain.shown)


def test_a_version_that_comes_again_is_the_same_condition():
    """Under its new number."""
    chain = chain_of([1, 0, 1, 0])
    chain.rename(1, 5)
    assert list(chain.path) == [5, 0, 5, 0]
    assert chain.shown[5].number == 3


def test_an_experiment_is_held_no_longer_than_it_is_shown():
    """Its samples may be a million; errors that were found of it go with it."""
    chain = chain_of([0, 1, 0, 1])
    model = PhysicsModel(load_machine("dc_motor"))
    newest = experiment(5)
    first = chain.expected_error(model, 1, newest)
    assert chain.expected_error(model, 1, newest) == first
    gone = weakref.ref(newest)
    del newest
    gc.collect()
    assert gone() is None
