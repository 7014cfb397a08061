"""What moving the limits of a diagnosis by a factor of two changes, and how it is counted."""

from __future__ import annotations

import json
from dataclasses import fields

import pytest

from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.lab.challenge.score.key import Truth
from tests.threshold_sensitivity import (
    ELSEWHERE,
    KEPT,
    OF_LAWS,
    OF_STANDING,
    changed,
    halved_and_doubled,
    limits,
    right,
    table,
)


def test_the_result_file_is_of_the_limits_of_today():
    """Each of them was moved in every case."""
    found = json.loads(KEPT.read_text("utf-8"))
    asked = {limit.name for limit in limits()}
    assert all(set(case["limits"]) == asked for case in found["cases"].values())
    known = {f.name for f in fields(THRESHOLDS)}
    assert known.issuperset([*ELSEWHERE, *OF_LAWS, *OF_STANDING])


@pytest.mark.parametrize(
    ("value", "both"),
    [
        (0.03, (0.015, 0.06)),
        (0.9, (0.8, 0.95)),
        (-0.95, (-0.9, -0.975)),
        (6, (3, 12)),
        (25, (12, 50)),
    ],
)
def test_a_limit_moves_to_both_sides(value, both):
    """A share of nine tenths cannot be doubled; what counts is how much it leaves."""
    assert halved_and_doubled(value) == pytest.approx(both)


def test_a_limit_is_changed_for_one_decision():
    """Afterwards it is what it was."""
    before = THRESHOLDS.law_error
    with changed("law_error", 2 * before):
        assert THRESHOLDS.law_error == 2 * before
    assert THRESHOLDS.law_error == before


def test_verdicts_are_judged_as_a_challenge_judges_them():
    """A group holds the truth, another name does not, and a foreign cause is unknown."""
    friction = Truth("case_0001", "single", ("coulomb_friction",))
    assert right(friction, ("ambiguous", [["stribeck_friction", "coulomb_friction"]]))
    assert not right(friction, ("effect", [["inertia"]]))
    assert not right(friction, ("unknown", []))
    assert right(Truth("case_0002", "outside", outside="belt"), ("unknown", []))


def test_a_change_is_counted_in_words():
    """Right answers that get wrong, wrong ones that get right, and all that differ."""
    names = [limit.name for limit in limits()]
    same, lost = [[True, False], [True, False]], [[False, True], [True, True]]
    cases = {"a": {"right": True, "limits": dict.fromkeys(names, same) | {"law_error": lost}}}
    (row,) = (r for r in table({"cases": cases}).splitlines() if "`law_error`" in r)
    assert row.endswith("| −1 +0 (1) | −0 +0 (1) |")
