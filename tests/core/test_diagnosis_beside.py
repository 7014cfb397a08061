"""Claims about a diagnosis beside the loop: when it takes part, whatever the computer's speed."""

from __future__ import annotations

import functools
import json
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from fake_archive import FakeArchive
from test_live_diagnosis import AUTO, LEVELS, SHORT, Scripted, auto_adaptor, worn

from ldt_core.base.experiment import Action, Adaptation, Level, Prediction, Signal
from ldt_core.twin.diagnoser import Diagnoser
from ldt_core.twin.stage import RecordedStep

#: Eccentricities, and what the detector says: 3 asks, then 8.
TRUTH = [0.0] * 2 + [0.008] * 5 + [0.012] * 4
SIGNS = "--+++-+++++"
SIGNALS = [Signal(i, LEVELS[s], "threshold", 7, 1.0) for i, s in enumerate(SIGNS, 1)]


@functools.cache
def experiments():
    """Made when they are first asked for: workers collect all tests, and would compile for it."""
    return [worn(e, i) for i, e in enumerate(TRUTH, 1)]


def answers(diagnoser, begin=0, stop=None):
    """What it answers to these experiments."""
    given = zip(experiments()[begin:stop], SIGNALS[begin:stop], strict=True)
    return [diagnoser.step(e, s) for e, s in given]


@pytest.mark.parametrize("after", [1, 2, 3])
def test_a_verdict_takes_part_at_the_stated_experiment(after):
    """It says which one asked, and was made of nothing that came later."""
    make = Scripted(TRUTH)
    told = [a for a in answers(Diagnoser(SHORT, {}, make, after)) if a is not None]
    assert [a.experiment - a.values["asked_at"] for a in told] == [after] * len(told)
    assert told[0].values["asked_at"] == 3
    assert make.asked[0] == [3]
    assert told[0].values["amount.unbalance.e"] == 0.008


def test_beside_the_loop_it_answers_as_in_it_however_long_it_takes():
    """Nobody waits for it before its time; then the loop does."""

    class Slow(Scripted):
        def __call__(self, machine, experiments, **how):
            time.sleep(0.3)
            return super().__call__(machine, experiments, **how)

    beside = Diagnoser(SHORT, {}, Slow(TRUTH), 3)
    with ThreadPoolExecutor(1) as beside.executor:
        began = time.monotonic()
        first = answers(beside, 0, 5)
        assert time.monotonic() - began < 0.3
        told = first + answers(beside, 5)
    assert told == answers(Diagnoser(SHORT, {}, Scripted(TRUTH), 3))
    assert any(told)


@pytest.mark.parametrize("end", range(len(TRUTH)))
def test_it_goes_on_in_the_middle_of_a_diagnosis(end):
    """From what was recorded, or from a checkpoint: the same verdicts of the same experiments."""
    through = answers(Diagnoser(SHORT, {}, Scripted(TRUTH), 3))
    kept = Adaptation(1, Action.KEPT, 7, "", {})
    recalled = Diagnoser(SHORT, {}, Scripted(TRUTH), 3)
    for e, s, found in zip(experiments()[:end], SIGNALS, through, strict=False):
        told = Prediction(e.number, e.start, e.period, 7, e.speed)
        recalled.recall(RecordedStep(e, told, s, kept, None, found))
    state = json.loads(json.dumps(recalled.state()))
    returned = Diagnoser(SHORT, {}, Scripted(TRUTH), 3)
    returned.return_to(state, FakeArchive(experiments(), (), [a for a in through if a]))
    assert answers(recalled, end) == through[end:]
    assert answers(returned, end) == through[end:]


def test_told_to_stop_it_breaks_off_what_is_under_way():
    """The loop, which waits for it, goes on at once and says so."""
    begun = threading.Event()

    def endless(machine, experiments, *, tick, workers):
        while True:
            begun.set()
            tick("thinking for ever")

    diagnoser = Diagnoser(SHORT, {}, endless, 1)
    with ThreadPoolExecutor(1) as diagnoser.executor:
        answers(diagnoser, 0, 3)
        assert begun.wait(5)
        diagnoser.cancel()
        assert answers(diagnoser, 3, 4) == [None]
    assert "broken off" in diagnoser.trouble


def test_the_experiment_in_which_the_machine_changed_is_left_out():
    """It asks for nothing; the next one does, and is diagnosed alone."""
    whole, half = worn(0.0, 3), len(experiments()[0]) // 2
    later = np.arange(len(whole)) >= half
    mixed = replace(whole, speed=np.where(later, whole.speed - 3.0, whole.speed))
    make = Scripted([0.0, 0.0, 0.0, 0.008])
    diagnoser = Diagnoser(SHORT, {}, make)
    given = [experiments()[0], experiments()[1], mixed, worn(0.008, 4)]
    signals = [Signal(i, LEVELS[s], "threshold", 7, 1.0) for i, s in enumerate("--++", 1)]
    told = [diagnoser.step(e, s) for e, s in zip(given, signals, strict=True)]
    assert [t is not None for t in told] == [False, False, False, True]
    assert make.asked == [[4]]


def test_a_first_experiment_that_is_wholly_new_counts():
    """The change fell between two."""
    changed = replace(worn(0.0, 3), speed=worn(0.0, 3).speed - 3.0)
    make = Scripted([0.0, 0.0, 0.008])
    diagnoser = Diagnoser(SHORT, {}, make)
    signal = Signal(3, Level.POSITIVE, "threshold", 7, 1.0)
    answers(diagnoser, 0, 2)
    assert diagnoser.step(changed, signal) is not None
    assert make.asked[0] == [3]


def test_the_adaptor_learns_by_the_verdict_from_its_time_on():
    """Before it there is no cause."""
    adaptor = auto_adaptor(TRUTH)
    adaptor.diagnoser = Diagnoser(SHORT, AUTO, Scripted(TRUTH), 2)
    told = [adaptor.step(e, s)[0] for e, s in zip(experiments()[2:5], SIGNALS[2:5], strict=True)]
    assert [t.action for t in told] == [Action.REFUSED, Action.REFUSED, Action.ADAPTED]
    assert adaptor.diagnosis.values["asked_at"] == 3
