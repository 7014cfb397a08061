"""The warning set S_w: bounded, and the same after a restart."""

import json

import numpy as np
import pytest
from fake_archive import FakeArchive
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.base.errors import OptionError, RecordingError
from ldt_core.base.experiment import Experiment
from ldt_core.twin.memory import Memory


def experiment(number, start=0.0, row=(1.0, 2.0), current=None):
    return Experiment(number, start, 0.1, row, row, current)


@given(st.integers(0, 6))
def test_it_survives_a_restart(count):
    """State through JSON text into a new memory: the same experiments, in their order."""
    memory = Memory(4, 2)
    made = [experiment(number, number / 3) for number in range(1, count + 1)]
    for one in made:
        memory.store(one)
        memory.remember(one)
    restored = Memory(4, 2)
    state = json.loads(json.dumps(memory.state(), allow_nan=False))
    restored.return_to(state, FakeArchive(made))
    assert restored.state() == memory.state()
    assert restored.experiments == memory.experiments == tuple(made[-4:])
    assert restored.recent == memory.recent == tuple(made[-2:])


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


@pytest.mark.parametrize(
    "change",
    [
        {"kept": None},
        {"kept": [[1]]},
        {"kept": [[n, 0.0] for n in range(60)]},
        {"recent": [[7, 0.0]]},
        {"dropped": -1},
        {"dropped": "1"},
    ],
)
def test_a_foreign_state_is_refused(change):
    """The memory is as it was."""
    memory = Memory()
    memory.store(experiment(1))
    before = memory.state()
    with pytest.raises((ValueError, TypeError, RecordingError)):
        memory.return_to({**before, **change}, FakeArchive([experiment(1)]))
    assert memory.state() == before


@pytest.mark.parametrize("limit", [0, -1, 2.5, "9", np.inf])
def test_a_bad_limit_is_named(limit):
    """The sentence names the parameter."""
    with pytest.raises(OptionError, match="memory_limit"):
        Memory(limit)
