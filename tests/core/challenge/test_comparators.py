"""The comparators on cases that they should get right, with a library of a few effects."""

from __future__ import annotations

import numpy as np
import pytest
from made_case import make_case

from ldt_core.effects import EFFECTS, get_effect
from ldt_core.lab.challenge.comparators import COMPARATORS, compare
from ldt_core.lab.challenge.comparators.selection import block_errors, improves
from ldt_core.lab.challenge.comparators.sparse_regression import TERMS
from ldt_core.machine.machine_file import machine_from_dict

pytestmark = pytest.mark.slow

FEW = ("coulomb_friction", "inertia", "sensor_bias", "quadratic_drag")


def answers(kind, effects, strength, wanted=tuple(COMPARATORS)):
    """Comparator to (its answer, errors of its prediction on the further experiments)."""
    case = make_case(
        *(kind, effects),
        seed=3,
        strength=strength,
        physics="dc_motor",
        excitation="reversing",
        start="rest",
        samples=400,
    )
    machine = machine_from_dict(case.machine, "case")
    chosen = {name: COMPARATORS[name] for name in wanted}
    found = {}
    for who, content, predict, seconds, error in compare(
        chosen, machine, case.experiments, [get_effect(n) for n in FEW]
    ):
        assert (error, seconds > 0) == ("", True), who
        found[who] = content, predict
    return case, found


@pytest.fixture(scope="module")
def friction():
    """A motor with strong dry friction."""
    pytest.importorskip("pysindy")
    return answers("single", ["coulomb_friction"], 20.0)


@pytest.mark.parametrize("who", [n for n in COMPARATORS if n != "gaussian_process"])
def test_each_finds_an_effect_that_cannot_be_missed(friction, who):
    """Dry friction of twenty times the noise is among what it names."""
    _, found = friction
    content, _ = found[who]
    assert "coulomb_friction" in content["verdict"]["effects"]
    assert content["verdict"]["acting"] == [[n] for n in content["verdict"]["effects"]]


@pytest.mark.parametrize("who", COMPARATORS)
def test_each_predicts_better_than_the_machine_file(friction, who):
    """It promises closure on held-out experiments and realises it on further ones."""
    case, found = friction
    content, predict = found[who]
    assert content["gap"]["closed_fraction"] > 0.5
    error = np.concatenate([e.speed - predict(e) for e in case.further[:4]])
    assert float(np.sqrt(np.mean(error**2))) < 0.5 * case.truth["gap_rms"]


def test_the_gaussian_process_names_nothing(friction):
    """It has no names."""
    content, _ = friction[1]["gaussian_process"]
    assert content["verdict"] == {"kind": "unnamed", "effects": [], "acting": []}


def test_bayes_names_no_effect_where_there_is_no_gap():
    """The price of a parameter is more than what chance pays."""
    _, found = answers("none", (), None, ("bic",))
    content, predict = found["bic"]
    assert (content["verdict"]["kind"], predict) == ("none", None)


def test_errors_that_fall_in_one_block_only_are_no_improvement():
    """One standard error is asked for; a free run that diverges never improves."""
    before = np.ones(10)
    assert improves(before, before - 0.01)
    assert not improves(before, before)
    lucky = before.copy()
    lucky[0], lucky[1:] = 0.0, 1.1
    assert not improves(before, lucky)
    case = make_case("none", seed=1, samples=100)
    wild = block_errors(case.experiments[:2], lambda e: np.full(len(e), np.nan))
    assert np.isfinite(wild).all()
    calm = block_errors(case.experiments[:2], lambda e: np.zeros(len(e)))
    assert not improves(calm, wild)


def test_terms_stand_for_effects_of_the_library():
    """So that a name in a table is a name of the contract."""
    assert {t.effect for t in TERMS} <= set(EFFECTS.names())
