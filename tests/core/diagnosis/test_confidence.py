"""How sure a verdict is: what the calibration on simulated cases says, and nothing beyond it."""

from __future__ import annotations

import json

import numpy as np
import pytest
from recorded_machines import MOTOR, record

from ldt_core.base.result_files import write
from ldt_core.diagnosis import set_fits
from ldt_core.diagnosis.attribution import covariance
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.confidence import GROUNDS, confidence, decades, table
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.diagnosis import Gap, HeldOutErrors
from ldt_core.diagnosis.effect_fit import EffectFit
from ldt_core.diagnosis.sentence import sentence
from ldt_core.effects import get_effect
from tests.confidence_calibration import TAKEN, cases, fitted, foretold, kept_cases


@pytest.mark.parametrize("kind", ["none", "effect", "ambiguous", "unknown"])
@pytest.mark.parametrize("far", [-1e9, 0.0, 1e9])
def test_no_more_is_stated_than_so_many_cases_can_show(kind, far):
    """Whatever speaks for a verdict, it stays within the range of its calibration."""
    low, high = table()["named" if kind in ("effect", "ambiguous") else kind]["range"]
    assert 0 < low <= confidence(kind, dict.fromkeys(GROUNDS, far)) <= high < 1


@pytest.mark.parametrize("power", [-3.0, 0.0, 0.5])
def test_powers_below_the_noise_have_a_logarithm(power):
    """What is left may by chance be less than nothing: a diagnosis must not end in an error."""
    assert decades(power, power) == 0.0
    assert decades(1000.0, power) == pytest.approx(3.0)


def test_a_gap_that_is_less_than_nothing_by_chance_has_a_covariance():
    """Without a gap its power scatters about 0, and may be far below beside a strong prior."""
    friction = Candidate(get_effect("coulomb_friction"), {})
    fit = EffectFit((friction,), (np.zeros(1),), np.zeros(3), np.ones((3, 1)), 0.0)
    assert covariance(fit, -5.0, -1e6) == pytest.approx(np.array([[1 / 3]]))


def test_the_table_knows_its_grounds():
    """Slopes are of grounds that a verdict states."""
    for kind, names in TAKEN.items():
        assert set(table()[kind]["slopes"]) <= set(names) <= set(GROUNDS)


def test_a_regression_finds_what_speaks_against_a_verdict(tmp_path):
    """Of verdicts that leave a large error few are right, and the table is less sure of them."""
    found = []
    for number in range(40):
        error = 0.1 * number
        right = number % 5 != 0 if error < 2 else number % 5 == 0
        name = f"case_{number:04d}"
        found.append({"who": "diagnosis", "case": name, "verdict": "unknown", "right": right})
        verdict = {"kind": "unknown", "grounds": {"over_noise": error, "strength": 1.0}}
        (tmp_path / name).mkdir()
        write(tmp_path / name / "diagnosis.json", json.dumps({"verdict": verdict}))
    write(tmp_path / "score.json", json.dumps({"cases": found}))
    made = fitted(cases([tmp_path]), "unknown")
    assert made["slopes"]["over_noise"] < 0
    assert made["cases"] == 40
    assert fitted(cases([tmp_path]), "none")["range"] == [0.5, 0.5]  # of none, nothing is known


def test_the_table_is_fitted_to_the_cases_that_are_kept():
    """Anyone can make it again, and see how it foretells cases that it was not fitted to."""
    known = kept_cases()
    for kind, names in TAKEN.items():
        made = fitted(known, kind)
        assert made["cases"] == table()[kind]["cases"]
        assert made["constant"] == pytest.approx(table()[kind]["constant"], abs=1e-3)
        assert made["slopes"] == pytest.approx(table()[kind]["slopes"], abs=1e-3)
        p, right = foretold(known, kind)
        if names:
            rate = right.mean()
            without = -np.log(np.where(right, rate, 1 - rate)).mean()
            assert -np.log(np.where(right, p, 1 - p)).mean() < without


@pytest.mark.slow
def test_a_search_ends_at_its_limit_of_work_and_answers(monkeypatch):
    """With hardly any work allowed the answer is still whole, and its grounds say why."""
    monkeypatch.setattr(set_fits, "MOST_WORK", 1)
    experiments = record(MOTOR, "coulomb_friction:torque=0.1", count=4)
    few = ("coulomb_friction", "viscous_friction", "inertia", "motor_constant", "constant_load")
    effects = [get_effect(name) for name in few]
    found = diagnose(MOTOR, experiments, effects=effects, workers=1)
    assert found.verdict.grounds["spent"] == 1.0
    assert found.verdict.kind in ("effect", "ambiguous", "unknown")
    assert len(found.verdict.acting) <= 1  # nothing was tried beside another effect
    assert any("limit of work" in note for note in found.notes)


def test_an_unknown_whose_search_ended_early_is_doubted_and_says_so():
    """A pair that was not tried explained what "none of the known effects" did, at 0.94."""
    grounds = {"left": -0.4, "over_noise": 1.8, "strength": 1.3}  # of such a case
    assert confidence("unknown", {**grounds, "spent": 1.0}) < confidence("unknown", grounds) - 0.1
    errors = HeldOutErrors(1.0, 2.0)
    gap = Gap(0.1, errors, errors, None, None, [])
    early, whole = (
        sentence("rotor", "unknown", [], {}, gap, [], 0.4, spent=spent) for spent in (True, False)
    )
    assert "before the limit of work" in early
    assert "none of the known" not in early
    assert "none of the known effects explains the gap." in whole


def test_an_effect_that_hardly_adds_is_named_with_less_assurance():
    """0.4 % of a resistance, which made up for another engine's steps, was named at 0.95."""
    grounds = {"margin": 3.0, "left": -3.0}
    sure, less = (confidence("effect", {**grounds, "weakest": w}) for w in (0.5, 2.5))
    assert less < sure - 0.1
