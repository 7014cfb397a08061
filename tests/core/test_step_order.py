"""Claims about the page and the picture of a run whose counter of experiments began anew."""

from __future__ import annotations

import numpy as np
import pytest
from test_counter_anew import COUNTERS, experiments, run, steps

from ldt_core.base.errors import RecordingError
from ldt_core.base.experiment import Experiment, Level, Prediction, Signal
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import BagWriter
from ldt_core.views.figures.run_figure import load_run
from ldt_core.views.report.report_page import page, read_run
from ldt_core.views.step_order import StepOrder
from ldt_core.views.step_view import StepView


def viewed(number: int, start: float) -> StepView:
    """A step of which only the experiment is known."""
    samples = np.zeros(2)
    one = Experiment(number, start, 0.1, samples, samples)
    return StepView(number, one, Prediction(number, start, 0.1, 0, samples))


@pytest.mark.parametrize("name", COUNTERS)
def test_every_step_is_shown_once_and_in_order(name, tmp_path):
    """Each has a number of its own there, above all that came before."""
    summary = run(tmp_path / "run", experiments(COUNTERS[name]), gate="none")
    shown, drawn = read_run(tmp_path / "run"), load_run(tmp_path / "run")
    numbers = [step.number for step in shown.steps]
    assert len(numbers) == summary.experiments == len(steps(tmp_path / "run"))
    assert numbers == sorted(set(numbers)) == [s.number for s in drawn.steps]
    assert numbers == [s.experiment for s in shown.signals]
    assert shown.summary.mme == pytest.approx(summary.mme)
    told = "counter restarted" in page(shown)
    assert told == bool(drawn.notes) == (name.startswith("begins anew") or name == "repeats")


def test_what_was_learned_from_is_named_as_it_is_shown(tmp_path):
    """A model of the second pass learned from the second pass's experiments."""
    run(tmp_path / "run", experiments(COUNTERS["begins anew"]), threshold=0.15)
    said = [m.trained_on for m in read_bag(tmp_path / "run").records("model")]
    shown = [m.trained_on for m in read_run(tmp_path / "run").models]
    assert len(said) == len(shown) > 2
    assert max(max(m, default=0) for m in said) <= 12
    assert max(shown[-1]) == 12 + max(said[-1])
    assert shown[1] == said[1]


def test_a_step_that_is_sent_again_stands_in_place_of_the_first():
    """Also behind the place where the counter began anew."""
    order = StepOrder()
    sent = [viewed(n, s) for n, s in [(1, 10.0), (2, 11.0), (1, 12.0), (2, 11.0), (3, 13.0)]]
    for step in sent:
        order.put(step)
    assert order.turn == 1
    assert order.steps() == [sent[0], sent[3], sent[2], sent[4]]
    assert [s.number for s in order.steps()[:2]] == [1, 2]


def test_a_run_of_which_nothing_was_judged_says_so(tmp_path):
    """It was "expected a run of live, got None"."""
    samples = np.zeros(2)
    with BagWriter(tmp_path / "run", machine="rotor") as writer:
        writer.write("experiment", Experiment(1, 10.0, 0.1, samples, samples), 11.0)
        writer.write("prediction", Prediction(1, 10.0, 0.1, 0, samples), 11.0)
        writer.write("signal", Signal(2, Level.NEGATIVE, "threshold", 0, 1.0), 12.0)
    with pytest.raises(RecordingError, match="run: expected an experiment with its prediction"):
        load_run(tmp_path / "run")
