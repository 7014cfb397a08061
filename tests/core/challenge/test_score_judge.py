"""What counts as right, and how much of it: on answers that are known."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from fake_answers import NOISE, SAMPLES, answer, further, judged, truth
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.lab.challenge.score.answer import CaseAnswer, Further, realised
from ldt_core.lab.challenge.score.judge import matched, overlap

FAILED = CaseAnswer("diagnosis", None, error="ZeroDivisionError: division by zero")


@pytest.mark.parametrize(
    ("given", "outcome", "right"),
    [
        (answer("effect", ["inertia"]), "outright", True),
        (answer("ambiguous", ["inertia", "sensor_lag"]), "group", True),
        (answer("ambiguous", ["sensor_lag", "sensor_gain"]), "wrong", False),
        (answer("effect", ["inertia"], ["sensor_gain"]), "wrong", False),
        (answer("effect", ["sensor_gain"]), "wrong", False),
        (answer("unknown"), "unknown", False),
        (answer("none"), "none", False),
        (FAILED, "failed", False),
    ],
)
def test_a_single_effect_is_named_outright_or_in_its_group(given, outcome, right):
    """And nothing besides it."""
    found = judged(truth("single", "inertia"), given)
    assert (found.outcome, found.right) == (outcome, right)


@pytest.mark.parametrize(
    ("given", "outcome"),
    [
        (answer("effect", ["inertia"], ["sensor_bias"]), "outright"),
        (answer("ambiguous", ["sensor_bias", "constant_load"], ["inertia"]), "group"),
        (answer("ambiguous", ["inertia", "sensor_bias"], ["sensor_bias"]), "group"),
        (answer("ambiguous", ["inertia", "sensor_bias"]), "part"),
        (answer("effect", ["inertia"]), "part"),
        (answer("effect", ["inertia"], ["sensor_gain"]), "wrong"),
        (answer("ambiguous", ["inertia", "sensor_bias"], ["sensor_gain"]), "wrong"),
        (answer("effect", ["inertia"], ["sensor_bias"], ["sensor_gain"]), "wrong"),
    ],
)
def test_of_a_pair_each_effect_needs_a_group_of_its_own(given, outcome):
    """One group that holds both names one of them only."""
    assert judged(truth("pair", "inertia", "sensor_bias"), given).outcome == outcome


def test_none_outside_and_left_out_have_right_answers_of_their_own():
    """Of an effect that is left out, one that closes as much of the gap is as good."""
    assert judged(truth("none"), answer("none")).right
    assert not judged(truth("none"), answer("unknown")).right
    outside = truth("outside", outside="backlash")
    assert judged(outside, answer("unknown")).right
    assert not judged(outside, answer("effect", ["inertia"])).right
    left = truth("left_out", "inertia", left_out="inertia")
    assert judged(left, answer("unknown")).right
    as_good = answer("effect", ["sensor_lag"], more=further(0.97, 0.97))
    assert judged(left, as_good).outcome == "equivalent"
    assert (
        judged(left, answer("effect", ["sensor_lag"], more=further(0.97, 0.8))).outcome == "wrong"
    )
    assert not judged(left, answer("none")).right


@given(
    st.lists(st.sampled_from("abcd"), unique=True, max_size=3),
    st.lists(st.lists(st.sampled_from("abcd"), unique=True, min_size=1), max_size=3),
)
def test_a_match_gives_each_effect_its_own_group_that_holds_it(effects, acting):
    """And there is one as soon as every effect has a group to itself."""
    met = matched(effects, acting)
    assert len(set(met.values())) == len(met)
    assert all(name in acting[k] for name, k in met.items())
    own = [[name] for name in effects]
    assert len(matched(effects, own)) == len(effects)


def amount(value, true, low, high, effect="coulomb_friction", parameter="torque"):
    parameters = {effect: {parameter: {"value": value, "unit": "", "ci95": [low, high]}}}
    key = {effect: {parameter: {"value": true, "unit": ""}}}
    given = answer("effect", [effect], parameters=parameters)
    (found,) = judged(truth("single", effect, parameters=key), given).amounts
    return found


def test_an_amount_is_off_by_its_part_of_the_true_one_and_its_interval_covers_or_not():
    """The 90 % interval is the shorter one: 1.645 / 1.96 of the half width."""
    found = amount(0.055, 0.05, 0.045, 0.065)
    assert (found.measure, found.absolute, found.covered) == ("size", None, (True, True))
    assert found.error == pytest.approx(0.1)
    assert amount(0.06, 0.05, 0.049, 0.071).covered == (True, False)
    assert amount(0.06, 0.05, 0.055, 0.065).covered == (False, False)


def test_a_factor_counts_from_1_and_an_angle_round_the_circle():
    """1.2 instead of 1.1 is twice the effect; -3.1 rad is next to 3.1 rad."""
    found = amount(1.2, 1.1, 1.05, 1.35, "inertia", "factor")
    assert (found.measure, found.error) == ("factor", pytest.approx(1.0))
    assert found.absolute == pytest.approx(0.1)
    found = amount(-3.1, 3.1, -3.2, -3.0, "gravity_imbalance", "phase")
    assert (found.measure, found.covered) == ("angle", (True, True))
    assert found.error == pytest.approx(2 * math.pi - 6.2)


def test_amounts_are_those_of_a_truth_named_outright_that_has_a_value():
    """No value in the key, no interval in the answer, another answer: nothing to compare."""
    assert amount(0.05, 0.05, None, None).covered is None
    key = {"coulomb_friction": {"torque": {"value": None, "unit": "N m"}}}
    about = truth("single", "coulomb_friction", parameters=key)
    own = {"coulomb_friction": {"torque": {"value": 1.0, "ci95": None}}}
    assert judged(about, answer("effect", ["coulomb_friction"], parameters=own)).amounts == ()
    assert judged(about, answer("unknown", parameters=own)).amounts == ()


def where(quantity, begin, end):
    return {"quantity": quantity, "from": begin, "to": end}


@pytest.mark.parametrize(
    ("true", "found", "right"),
    [
        (where("speed", 10.0, 20.0), where("speed", 12.0, 21.0), True),
        (where("speed", 10.0, 20.0), where("speed", 16.0, 30.0), False),
        (where("speed", 10.0, 20.0), where("voltage", 10.0, 20.0), False),
        # Open upwards: as far as the recording goes, here 40 rad/s.
        (where("speed", 30.0, None), where("speed", 30.0, 40.0), True),
        (where("speed", 30.0, 1000.0), where("speed", 31.0, 40.0), True),
        # Either sign: the size of the voltage, of which the recording has 0 to 16 V.
        ({**where("voltage", 10.0, 24.0), "either_sign": True}, where("voltage", -16, -10), True),
        ({**where("voltage", 10.0, 24.0), "either_sign": True}, where("voltage", -16, 16), False),
        # Beyond what was recorded: nobody's to find.
        (where("speed", 50.0, None), where("speed", 30.0, 40.0), None),
    ],
)
def test_a_place_is_right_if_it_overlaps_the_true_one_by_half(true, found, right):
    """Of what the recording reaches."""
    ranges = {"speed": [0.0, 40.0], "voltage": [-16.0, 16.0]}
    given = answer("unknown", where=[where("time", 0.0, 1.0), found], ranges=ranges)
    assert judged(truth("outside", outside="x", place=true), given).place is right
    assert judged(truth("outside", outside="x"), given).place is None


@given(*[st.floats(0, 10) for _ in range(4)])
def test_overlap_is_symmetric_and_between_nothing_and_all(a, b, c, d):
    """1 of a range with itself."""
    one, two = (min(a, b), max(a, b)), (min(c, d), max(c, d))
    assert 0 <= overlap(one, two) == overlap(two, one) <= 1
    assert overlap(one, one) == 1


def test_closure_is_promised_and_realised_by_excitation():
    """For answers that name something to add; noise does not count as gap."""
    about, more = truth("single", "inertia"), further(0.9, 0.6)
    found = judged(about, answer("effect", ["inertia"], closed=0.92, more=more))
    assert found.closure["same"] == (0.92, pytest.approx(0.9))
    assert found.closure["another"] == (0.92, pytest.approx(0.6))
    assert judged(about, answer("unknown", closed=0.92, more=more)).closure == {}
    refused = replace(answer("effect", ["inertia"], closed=0.92, more=more), refused="backward")
    assert set(judged(about, refused).closure) == {"same"}
    assert realised(further(0.9, 0.9, gap=0.001), NOISE) is None
    assert realised((), NOISE) is None


def test_closure_is_counted_from_the_noise_as_it_fell_out():
    """A gap smaller than the noise is all closed, although the noise was larger than on average."""
    loud, gap = 1.05 * NOISE, 0.3 * NOISE
    shares = [(gap**2 + loud**2, loud**2)] * 7
    more = tuple(
        Further(n, SAMPLES, SAMPLES * a, SAMPLES * b) for n, (a, b) in enumerate(shares, start=11)
    )
    given = answer("effect", ["inertia"], closed=1.0, more=more)
    fell = {n: loud for n in range(11, 18)}
    found = judged(truth("single", "inertia", further_noise=fell), given)
    assert found.closure["same"] == (1.0, pytest.approx(1.0))
    assert judged(truth("single", "inertia"), given).closure["same"][1] < 0.6
