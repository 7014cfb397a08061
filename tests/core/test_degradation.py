"""Wear: when it changes, by how much, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.base.errors import MachineFileError, OptionError
from ldt_core.machine.degradation import KINDS, Schedule, schedule
from ldt_core.machine.machine_file import load_machine

ROTOR = load_machine("rotor")
WEAR = dict(ROTOR.simulation["degradation"])


def worn(kind, n, steps=12, seed=0, begin=0.0, end=0.012):
    return Schedule(kind, "unbalance", "e", begin, end, steps, n, seed)


@given(
    n=st.integers(1, 300),
    steps=st.integers(1, 40),
    seed=st.integers(0, 2**32 - 1),
    end=st.floats(-1, 1),
)
def test_a_staircase_rises_by_equal_steps_each_held_for_an_experiment_or_more(n, steps, seed, end):
    """From `begin` to `end`, monotone, with as many rises as asked for and possible."""
    s = worn("staircase", n, steps, seed, 0.5, end)
    levels = list(dict.fromkeys(s.values))
    rises = min(steps, n - 1)
    assert len(s.values) == n
    assert s.values[0] == 0.5
    np.testing.assert_allclose(
        levels, np.linspace(0.5, end, rises + 1) if rises and end != 0.5 else [0.5], atol=1e-12
    )
    if end != 0.5:
        assert len(s.changes) == rises
        assert all(s.value(i) != s.value(i - 1) for i in s.changes)


def test_every_moment_of_a_rise_is_equally_likely():
    """Over 2000 seeds, each of the 19 possible experiments begins a rise in 4 of 19."""
    counts = np.zeros(21)
    for seed in range(2000):
        counts[worn("staircase", 20, 4, seed).changes] += 1
    assert counts[:2].sum() == 0
    np.testing.assert_allclose(counts[2:] / 2000, 4 / 19, atol=0.04)  # 4 standard deviations


@given(n=st.integers(1, 200), seed=st.integers(0, 1000), kind=st.sampled_from(KINDS))
def test_the_same_seed_wears_the_same_way(n, seed, kind):
    """And every value lies between the two ends."""
    s = worn(kind, n, seed=seed)
    assert s == worn(kind, n, seed=seed)
    assert all(0 <= v <= 0.012 for v in s.values)
    assert s.value(n + 5) == s.values[-1]


def test_the_other_kinds_do_what_they_are_called():
    """A ramp rises always, abrupt once in the middle half, repaired ends as it began."""
    assert worn("ramp", 5).values == pytest.approx((0.0, 0.003, 0.006, 0.009, 0.012))
    assert worn("ramp", 5).changes == [2, 3, 4, 5]
    for seed in range(50):
        (change,) = worn("abrupt", 40, seed=seed).changes
        assert 11 <= change <= 31
    fixed = worn("repaired", 40)
    assert max(fixed.values) == fixed.value(30) == 0.012
    assert set(fixed.values[30:]) == {0.0}
    assert len(fixed.changes) == 13
    assert Schedule(experiments=10).changes == []


def test_the_machine_file_says_what_wears_and_options_change_it():
    """The rotor's staircase; another kind and another end on request; none without a section."""
    s = schedule(ROTOR, 200, 3)
    assert (s.kind, s.effect, s.parameter, s.end, s.steps) == (
        *("staircase", "unbalance", "e", 0.012, 12),
    )
    assert schedule(ROTOR, 200, 3, "ramp", 0.01).values[-1] == 0.01
    assert schedule(ROTOR, 200, 3, "none").kind == "none"
    bare = replace(ROTOR, simulation={})
    assert schedule(bare, 200, 3).kind == "none"
    with pytest.raises(OptionError, match=r"degradation 'ramp': expected simulation\.degradation"):
        schedule(bare, 200, 3, "ramp")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"kind": "stairs"}, "did you mean 'staircase'"),
        ({"stepz": 3}, "unknown key 'stepz'"),
        ({"steps": 0}, "steps: expected a whole number from 1"),
        ({"steps": 2.5}, "steps: expected a whole number from 1"),
        ({"effect": "unbalanced"}, "did you mean 'unbalance'"),
        ({"parameter": "f"}, "effect unbalance: expected one of 'e'"),
        ({"to": -1}, "effect unbalance, e: expected at least 0 m, got -1"),
        ({"from": "low"}, "from: expected a number"),
    ],
)
def test_what_is_no_wear_is_refused_with_a_sentence(change, words):
    """Unknown kinds, keys, effects, and values that the effect cannot have."""
    machine = replace(ROTOR, simulation={"degradation": {**WEAR, **change}})
    with pytest.raises(MachineFileError, match=words):
        schedule(machine, 10, 0)


def test_a_missing_key_is_named():
    """Effect without parameter."""
    given = {k: v for k, v in WEAR.items() if k != "parameter"}
    with pytest.raises(MachineFileError, match="expected the key 'parameter'"):
        schedule(replace(ROTOR, simulation={"degradation": given}), 10, 0)


def test_a_recurring_wear_goes_back_and_forth():
    """Only the two ends occur, alternately, with as many changes as asked for."""
    s = worn("recurring", 100, steps=5, begin=0.002, end=0.008)
    levels = [s.values[0], *(s.value(i) for i in s.changes)]
    assert levels == [0.002, 0.008, 0.002, 0.008, 0.002, 0.008]
