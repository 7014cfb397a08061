"""The warning set S_w: bounded, and the same after a restart."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Experiment
from ldt_core.twin.memory import Memory

samples = st.lists(st.floats(-1e300, 1e300), min_size=1, max_size=5)


def experiment(number, start=0.0, row=(1.0, 2.0), current=None):
    return Experiment(number, start, 0.1, row, row, current)


@given(st.lists(st.tuples(samples, st.booleans()), max_size=6))
def test_it_survives_a_restart_to_the_last_bit(rows):
    """State through JSON text into a new memory: every sample is equal."""
    memory = Memory(4)
    for number, (row, measured) in enumerate(rows, start=1):
        memory.store(experiment(number, number / 3, row, row if measured else None))
    restored = Memory(4)
    restored.restore(json.loads(json.dumps(memory.state(), allow_nan=False)))
    assert restored.state() == memory.state()
    for own, other in zip(memory.experiments, restored.experiments, strict=True):
        assert (own.number, own.start, own.period) == (other.number, other.start, other.period)
        assert own.voltage.tobytes() == other.voltage.tobytes()
        assert own.speed.tobytes() == other.speed.tobytes()
        assert (own.current is None) == (other.current is None)


@given(st.integers(1, 8), st.integers(0, 20))
def test_above_the_limit_the_oldest_leave(limit, count):
    """The youngest stay, in their order, and the others are counted."""
    memory = Memory(limit)
    for number in range(1, count + 1):
        memory.store(experiment(number))
    expected = list(range(1, count + 1))[-limit:]
    assert [e.number for e in memory.experiments] == expected
    assert memory.dropped == max(0, count - limit)


def test_it_is_a_set():
    """The same experiment again takes the place of the first; a new run's number 1 does not."""
    memory = Memory()
    memory.store(experiment(1))
    memory.store(experiment(1, row=(3.0, 4.0)))
    memory.store(experiment(1, start=60.0))
    assert [e.speed[0] for e in memory.experiments] == [3.0, 1.0]
    assert [e.speed[0] for e in memory.union(experiment(1))] == [1.0, 1.0]
    assert len(memory) == 2, "union must leave the set as it is"


def test_cleared_it_is_empty_and_still_counts():
    """S_w ← ∅ does not hide what was lost."""
    memory = Memory(1)
    memory.store(experiment(1))
    memory.store(experiment(2))
    memory.clear()
    assert (len(memory), memory.dropped) == (0, 1)


def test_a_smaller_memory_takes_what_it_can():
    """A restart with a lower limit keeps the youngest."""
    memory, small = Memory(5), Memory(2)
    for number in range(1, 6):
        memory.store(experiment(number))
    small.restore(memory.state())
    assert [e.number for e in small.experiments] == [4, 5]
    assert small.dropped == 3


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"experiments": None}, "TypeError"),
        ({"experiments": [{"number": 1}]}, "start"),
        ({"experiments": [{**Memory().state(), "number": 0}]}, "KeyError"),
        ({"dropped": -1}, "whole number from 0"),
        ({"dropped": "1"}, "whole number from 0"),
    ],
)
def test_a_foreign_state_is_refused(change, words):
    """One sentence, and the memory is as it was."""
    memory = Memory()
    memory.store(experiment(1))
    before = memory.state()
    with pytest.raises(OptionError, match=r"state of the memory") as caught:
        memory.restore({**before, **change})
    assert words in str(caught.value)
    assert memory.state() == before


def test_samples_that_are_not_finite_are_refused():
    """A damaged file does not bring NaN into the training."""
    memory = Memory()
    memory.store(experiment(7))
    state = memory.state()
    state["experiments"][0]["speed"][1] = float("nan")
    with pytest.raises(OptionError, match="experiment 7, speed"):
        Memory().restore(state)


@pytest.mark.parametrize("limit", [0, -1, 2.5, "9", np.inf])
def test_a_bad_limit_is_named(limit):
    """The sentence names the parameter."""
    with pytest.raises(OptionError, match="memory_limit"):
        Memory(limit)
