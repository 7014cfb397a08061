"""Claims about experiment numbers: whatever the counter does, the twin finds back."""

from __future__ import annotations

import numpy as np
import pytest

from ldt_core.base.errors import ExperimentError, RepeatedExperiment
from ldt_core.base.experiment import Experiment
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.experiment_numbers import MOST_JUMP
from ldt_core.twin.loop import Twin
from ldt_core.twin.numbering import Numbering

REST = np.zeros(3)


def experiment(number: float, start: float) -> Experiment:
    """A short one at rest."""
    return Experiment(number, start, 0.01, REST, REST)


def taken(numbers: list[float], starts: list[float] | None = None) -> list[float]:
    """The numbers that are taken of those that come, one a second unless their starts are given."""
    rule, found = Numbering(), []
    for number, start in zip(numbers, starts or range(len(numbers)), strict=True):
        try:
            rule.admit(experiment(number, start))
        except ExperimentError:
            continue
        found.append(number)
    return found


def test_a_number_out_of_nowhere_costs_itself():
    """The largest that a float64 has exactly, for one; the others go on."""
    assert taken([1, 2, 2**53 - 1, 3, 4]) == [1, 2, 3, 4]
    assert taken([2**53 - 1, 1, 2, 3]) == [2**53 - 1, 2, 3]
    assert taken([1, 2, 3, 2, 4, 1, 5]) == [1, 2, 3, 4, 5]
    for number in (2**53, 1e300):
        with pytest.raises(ExperimentError, match=r"whole number from 1 below 2\^53"):
            experiment(number, 0.0)


def test_a_counter_that_begins_at_1_again_costs_one_experiment():
    """Three where its clock went back as well; each time that it happens."""
    assert taken([*range(1, 30), 1, 2, 3, 4, 1, 2, 3]) == [*range(1, 30), 2, 3, 4, 2, 3]
    starts = [*range(1000, 1029), *range(6)]
    assert taken([*range(1, 30), *range(1, 7)], starts) == [*range(1, 30), 4, 5, 6]


def test_a_jump_that_lasts_is_followed():
    """Nothing is missing for ever; a gap of less is none."""
    assert taken([1, 2, 10**9, 10**9 + 1, 10**9 + 2]) == [1, 2, 10**9 + 1, 10**9 + 2]
    assert taken([1, 1 + MOST_JUMP, 2 + MOST_JUMP]) == [1, 1 + MOST_JUMP, 2 + MOST_JUMP]


def test_what_comes_again_is_a_repetition_also_after_a_new_beginning():
    """It must not count twice."""
    rule = Numbering()
    for number, start in ((1, 0.0), (2, 1.0), (3, 2.0)):
        rule.admit(experiment(number, start))
    with pytest.raises(ExperimentError, match="a number above 3, or the next ones to count on"):
        rule.admit(experiment(1, 3.0))
    rule.admit(experiment(2, 4.0))
    for number, start in ((3, 2.0), (1, 0.0), (2, 4.0)):
        with pytest.raises(RepeatedExperiment):
            rule.admit(experiment(number, start))
    assert rule.last == 2


def test_the_twin_goes_on_after_a_counter_that_began_anew():
    """In a run without ROS, as it does in the graph."""
    twin = Twin(load_machine("rotor"), model="physics")
    numbers = [1, 2, 3, 1, 2, 3]
    steps = list(twin.steps(experiment(n, i) for i, n in enumerate(numbers)))
    assert [s.number for s in steps] == [1, 2, 3, 2, 3]
