"""Claims about the sentence: it says where the gap lies no more surely than it is."""

from __future__ import annotations

from dataclasses import replace

import pytest

from ldt_core.diagnosis.diagnosis import Gap, GapLocation, HeldOutErrors, ParameterAmount, Refit
from ldt_core.diagnosis.next_experiment import apart
from ldt_core.diagnosis.nominal import beside_effects, closing
from ldt_core.diagnosis.sentence import grown, sentence
from ldt_core.effects import get_effect

GAP = Gap(0.1, HeldOutErrors(2.0, 5.0), HeldOutErrors(2.0, 5.0), None, None, [])


def told(*places):
    return sentence("rig", "unknown", [], {}, GAP, places, 0.5)


def place(begin, end, share, quantity="speed", unit="rad/s"):
    return GapLocation(quantity, begin, end, unit, share, 0.2)


@pytest.mark.parametrize(
    ("places", "words"),
    [
        ([place(15.0, 31.0, 0.95)], "which lies at speeds from 15 to 31 rad/s. The best"),
        ([place(15.0, 31.0, 0.6)], "60% of which lies at speeds from 15 to 31 rad/s. The best"),
        (
            [place(-31.0, -15.0, 0.5), place(2.0, 4.0, 0.7, "time", "s"), place(15.0, 31.0, 0.3)],
            "80% of which lies at speeds from 15 to 31 rad/s in both directions. The best",
        ),
        ([place(3.0, 3.0, 1.0, "experiment", "")], "which lies in experiment 3. The best"),
        ([place(3.0, 5.0, 1.0, "experiment", "")], "which lies in experiments 3 to 5. The best"),
    ],
)
def test_the_sentence_says_where_and_how_much(places, words):
    """The share too, unless it is nearly all; and what is alike in both directions once."""
    assert words in told(*places)


def test_a_gap_that_is_everywhere_has_no_place_in_the_sentence():
    """Its place is all of the data."""
    assert "lies" not in told(GapLocation("speed", 0.0, 40.0, "rad/s", 1.0, 1.0))


def test_what_the_best_set_leaves_is_told_of_what_nominal_parameters_leave():
    """It "left 15 % of the gap" where these had closed 99 % of it."""
    rows = [Refit(n, 1.1, ends, 0.05, 0.99) for n, ends in (("J", (1.05, 1.15)), ("R", (0.9, 1.3)))]
    where = [place(15.0, 31.0, 0.95)]
    words = sentence("rig", "unknown", [], {}, GAP, where, 0.15, own=closing(rows))
    assert words.startswith(
        "Unknown: nominal parameters (J × 1.1) close 99% of the gap, and none of the known effects "
        "explains the rest, which lies at speeds from 15 to 31 rad/s. The best set of them leaves "
        "15% of it."
    )


def test_where_an_unbalance_acts_at_steady_speeds_is_said_if_it_is_elsewhere():
    """A quick run shows the gap past the resonances, and the reader wants to know of both."""
    steady = replace(place(16.5, 30.1, 0.5), steady=True)
    assert "(at steady speeds it acts from 16.5 to 30.1 rad/s)" in told(
        place(28.3, 31.0, 0.9), steady
    )
    assert "steady" not in told(place(17.0, 29.0, 0.9), steady)


@pytest.mark.parametrize(("rmse", "is_noise"), [(0.11, True), (1.8, False)])
def test_an_error_far_beyond_the_noise_is_never_said_to_be_the_noise(rmse, is_noise):
    """A foundation that still swung was "predicted to 0.18 rad/s, which is the noise (0.016)"."""
    error = HeldOutErrors(rmse, 2 * rmse)
    words = sentence("rig", "none", [], {}, replace(GAP, before=error, after=error), (), None)
    assert words.startswith("No gap")
    assert ("which is the noise" in words) is is_noise
    assert f"{rmse:g} rad/s" in words


@pytest.mark.parametrize(("left", "more"), [(0.15, False), (0.5, True)])
def test_what_a_cause_leaves_beyond_the_noise_is_said_to_have_none(left, more):
    """A clutch that slips was an inertia that "explains 100% of the gap", at five times the noise.

    What it explains is right, and so is that this is not all.
    """
    gap = replace(GAP, after=HeldOutErrors(left, 2 * left), closed_fraction=1.0)
    amount = {"inertia": {"factor": ParameterAmount(0.55, "", (0.53, 0.57))}}
    words = sentence("rig", "effect", [["inertia"]], amount, gap, (), 0.0)
    assert ("its cause is not known" in words) is more


def test_sets_that_are_alike_are_named_by_what_not_all_of_them_have():
    """ "tells inertia and coulomb_friction and inertia and stribeck_friction apart" named four."""
    sets = [("inertia", "coulomb_friction"), ("inertia", "stribeck_friction", "sensor_lag")]
    assert apart(sets) == "coulomb friction and stribeck friction with sensor lag"
    assert apart([("inertia",), ("inertia", "sensor_lag")]) == "sensor lag and its absence"
    assert apart([("sensor_lag",)] * 3) == "these amounts of sensor lag"


def test_of_what_the_machine_file_knows_both_values_are_told():
    """A friction that had grown by 40 % showed its new amount alone."""
    words = grown(get_effect("coulomb_friction"), {"torque": 0.0249}, {"torque": 0.0349})
    assert words == (
        "coulomb friction, from the machine file's to what is found: torque 0.0249 to 0.0349 N m"
    )


def test_numbers_of_the_file_that_close_most_of_a_gap_are_told_beside_the_effects_named():
    """A pump's inertia rose by 40 %; the sentence had a friction and a sensor's gain alone."""
    rows = [Refit(n, 1.27, ends, 0.1, 0.99) for n, ends in (("J", (1.26, 1.28)), ("R", (0.9, 1.3)))]
    assert beside_effects(rows) == (
        "Fitted along, within their tolerances: J × 1.27. Such numbers alone close 99% of the gap."
    )
    assert beside_effects([replace(r, closed_fraction=0.3) for r in rows]) == ""
    assert beside_effects(rows[1:]) == ""
