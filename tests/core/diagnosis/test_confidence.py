"""How sure a verdict is: what the calibration on simulated cases says, and nothing beyond it."""

from __future__ import annotations

import json

import pytest
from recorded_machines import MOTOR, record

from ldt_core.base.result_files import write
from ldt_core.diagnosis import effect_set_search
from ldt_core.diagnosis.confidence import GROUNDS, confidence, table
from ldt_core.diagnosis.diagnose import diagnose
from tests.confidence_calibration import TAKEN, cases, fitted


@pytest.mark.parametrize("kind", ["none", "effect", "ambiguous", "unknown"])
@pytest.mark.parametrize("far", [-1e9, 0.0, 1e9])
def test_no_more_is_stated_than_so_many_cases_can_show(kind, far):
    """Whatever speaks for a verdict, it stays within the range of its calibration."""
    low, high = table()["named" if kind in ("effect", "ambiguous") else kind]["range"]
    assert 0 < low <= confidence(kind, dict.fromkeys(GROUNDS, far)) <= high < 1


def test_the_table_knows_its_grounds():
    """Slopes are of grounds that a verdict states."""
    for kind, names in TAKEN.items():
        assert set(table()[kind]["slopes"]) <= set(names) <= set(GROUNDS)


def test_a_regression_finds_what_speaks_against_a_verdict(tmp_path):
    """Of verdicts that leave much, few are right: the fitted table is less sure of them."""
    found = []
    for number in range(40):
        left = -3.0 + 0.1 * number
        right = number % 5 != 0 if left < -1 else number % 5 == 0
        name = f"case_{number:04d}"
        found.append({"who": "diagnosis", "case": name, "verdict": "effect", "right": right})
        verdict = {"kind": "effect", "grounds": {"left": left, "effects": 1.0}}
        (tmp_path / name).mkdir()
        write(tmp_path / name / "diagnosis.json", json.dumps({"verdict": verdict}))
    write(tmp_path / "score.json", json.dumps({"cases": found}))
    made = fitted(cases([tmp_path]), "named")
    assert made["slopes"]["left"] < 0
    assert made["cases"] == 40
    assert fitted(cases([tmp_path]), "none")["range"] == [0.5, 0.5]  # of none, nothing is known


def test_a_search_ends_at_its_limit_of_work_and_answers(monkeypatch):
    """With hardly any work allowed the answer is still whole, and its grounds say why."""
    monkeypatch.setattr(effect_set_search, "MOST_WORK", 1)
    experiments = record(MOTOR, "coulomb_friction:torque=0.1", count=4)
    found = diagnose(MOTOR, experiments, workers=1)
    assert found.verdict.grounds["spent"] == 1.0
    assert found.verdict.kind in ("effect", "ambiguous", "unknown")
    assert len(found.verdict.acting) <= 1  # nothing was tried beside another effect
