"""The default twin stays as good as it was on four streams, and on single hard experiments."""

from __future__ import annotations

import json

import pytest

from ldt_core.base.experiment import Action
from ldt_core.base.pausable import finished
from ldt_core.estimation.misfit import misfit
from ldt_core.lab.study.robustness.streams import STREAMS
from ldt_core.models.grey_box import GreyBoxModel
from ldt_core.twin.contest import SEARCHING, UNDER_WAY
from ldt_core.twin.loop import Twin
from tests.robustness_short import FILE, SHORT, left

pytestmark = pytest.mark.usefixtures("one_core")

#: Of the share written beside it that a share may have grown by.
GROWTH = 0.1


@pytest.mark.slow
@pytest.mark.parametrize("stream", SHORT)
def test_what_is_left_has_not_grown_by_a_tenth(stream):
    """Over the figure that `python -m tests.robustness_short` wrote."""
    assert left(stream) <= (1 + GROWTH) * json.loads(FILE.read_text())[stream]


def test_every_stream_has_its_figure():
    """And no other one stands in the file; the README's first command leaves less than a third."""
    figures = json.loads(FILE.read_text())
    assert set(figures) == set(SHORT)
    assert (1 + GROWTH) * figures["staircase"] <= 0.3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stream", "seed", "effects"),
    [
        ("foundation_10_e10", 5, {"unbalance"}),
        ("foundation_10_e6", 6, {"unbalance"}),
        ("drag_e6", 9, {"unbalance", "quadratic_drag"}),
        ("drag_e10", 0, {"unbalance", "quadratic_drag"}),
    ],
)
def test_an_effect_that_wakes_parameters_is_found_although_they_are_off(stream, seed, effects):
    """A foundation moves nothing before an unbalance shakes it, and is 10 % beside its file."""
    given = STREAMS[stream](seed, 1)
    twin = Twin(given.machine)
    (first,) = given.experiments
    assert twin.step(first).adaptation.action is Action.ADAPTED
    assert isinstance(twin.model, GreyBoxModel)
    assert {e.name for e in twin.model.effects} == effects
    assert misfit(first.speed - twin.model.predict(first).speed).explained


@pytest.mark.slow
def test_a_search_that_goes_on_holds_no_new_experiment_up():
    """The first experiment, which a resonance captured, was searched for all twenty: 84 % left."""
    given = STREAMS["foundation_10_e10"](6, 3)
    twin = Twin(given.machine)
    steps = [twin.step(e) for e in given.experiments]
    assert steps[0].adaptation.details[SEARCHING] == UNDER_WAY
    assert isinstance(twin.model, GreyBoxModel)
    assert steps[-1].signal.max_error < 0.2 * steps[-1].original.max_error(steps[-1].experiment)


@pytest.mark.slow
def test_a_fit_that_the_observer_led_right_is_right_in_free_run():
    """Where a shaft is caught a little too early or too late, the free run has many minima."""
    given = STREAMS["staircase_200"](0, 200)
    e = given.experiments[129]
    (model,) = finished(Twin(given.machine).model.with_other_causes([e]))
    assert misfit(e.speed - model.predict(e).speed).explained
