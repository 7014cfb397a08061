"""The figures of a score, their intervals, words and pictures."""

from __future__ import annotations

import json

import pytest
from fake_answers import answer, further, judged, truth

from ldt_core.lab.challenge.score.score import ChallengeScore
from ldt_core.lab.challenge.score.score_files import confusion, write_score
from ldt_core.lab.challenge.score.score_table import ScoreTable
from ldt_core.lab.statistics import proportion, resampled

pytestmark = pytest.mark.slow


def some(who="diagnosis"):
    """Four single effects, of which one is missed; one case of every other kind."""
    single, more = truth("single", "inertia", snr=5.0), further(0.9, 0.5)
    right = answer("effect", ["inertia"], who=who, closed=0.92, more=more, seconds=4.0)
    return [
        *[judged(single, right)] * 2,
        judged(single, answer("ambiguous", ["inertia", "sensor_lag"], who=who, seconds=6.0)),
        judged(truth("single", "sensor_bias", snr=0.5), answer("none", who=who, seconds=1.0)),
        judged(truth("pair", "inertia", "sensor_bias"), answer("unknown", who=who)),
        judged(truth("none", snr=0.0), answer("none", who=who)),
        judged(truth("outside", outside="backlash", snr=20.0), answer("unknown", who=who)),
        judged(truth("left_out", "inertia", left_out="inertia"), answer("unknown", who=who)),
    ]


def test_shares_and_means_are_those_of_the_cases_of_a_kind():
    table = ScoreTable({"diagnosis": some()})

    def value(figure, kind):
        return table.get("diagnosis", figure, kind).value

    assert value("right", "single") == 0.75
    assert value("named outright", "single") == 0.5
    assert value("in its group", "single") == 0.25
    assert value("called none", "single") == 0.25
    assert value("called unknown", "named") == 0.2
    assert value("right", "named") == 0.6
    assert value("right", "all") == pytest.approx(6 / 8)
    assert value("names in a group", "single") == pytest.approx(4 / 3)
    assert value("closure within 5 points, same excitation", "all") == 1.0
    assert value("closure within 5 points, another excitation", "all") == 0.0
    assert value("closure off by, another excitation", "all") == pytest.approx(0.42)
    assert value("CPU seconds, median", "single") == 4.0
    assert value("CPU seconds, most", "single") == 6.0
    assert table.get("diagnosis", "place right") is None
    assert value("equivalent", "single") == 0.0


def test_shares_have_wilsons_interval():
    """Of 8 in 10: 0.490 to 0.943 (Wilson, 1927, as tabulated by Newcombe's formula)."""
    found = proportion(8, 10, method="wilson")
    assert (found.value, found.count) == (0.8, 10)
    assert found.low == pytest.approx(0.4902, abs=1e-4)
    assert found.high == pytest.approx(0.9433, abs=1e-4)
    assert proportion(0, 0, method="wilson").value is None


def test_draws_take_cases_whole():
    """Two cases of equal values each leave three possible means, not more."""
    found = resampled([[0.0] * 5, [1.0] * 5], lambda values: float(values.mean()))
    assert (found.value, found.low, found.high, found.count) == (0.5, 0.0, 1.0, 2)
    assert resampled([[], []], max).value is None


def test_a_row_of_the_confusion_adds_up_to_its_cases():
    """Groups are shared among their names, sets among their effects."""
    two = truth("single", "sensor_bias")
    both = judged(two, answer("effect", ["sensor_bias"], ["inertia"]))
    rows, columns, shares, numbers = confusion([*some()[:4], both])
    assert (rows, numbers) == (["inertia", "sensor_bias"], [3, 2])
    assert shares.sum(axis=1) == pytest.approx(1.0)
    at = columns.index
    assert shares[0, at("inertia")] == pytest.approx(2.5 / 3)
    assert shares[0, at("sensor_lag")] == pytest.approx(0.5 / 3)
    assert shares[1, at("none")] == 0.5
    assert shares[1, at("inertia")] == 0.25


def test_a_score_is_written_as_numbers_a_table_and_a_picture(tmp_path):
    """With the hash of each key, and whoever answered side by side."""
    found = {"diagnosis": some(), "greedy": some("greedy")}
    score = ChallengeScore(
        {"answers.json": "f" * 64}, found, ScoreTable(found), {"ldt": "1", "code": "2"}
    )
    files = write_score(score, tmp_path)
    assert all(f.stat().st_size for f in files)
    assert {f.name for f in files} == {"score.md", "score.json", "confusion.png"}
    assert (tmp_path / "confusion.svg").exists()
    plain = json.loads((tmp_path / "score.json").read_text())
    assert plain["keys"] == [{"file": "answers.json", "sha256": "f" * 64}]
    assert len(plain["cases"]) == 16
    row = next(r for r in plain["figures"] if (r["figure"], r["kind"]) == ("right", "single"))
    assert (row["who"], row["value"], row["count"]) == ("diagnosis", 0.75, 4)
    text = (tmp_path / "score.md").read_text()
    assert "`" + "f" * 64 + "`" in text
    share = "75.0 % [30.1, 95.4] of 4"
    assert f"| single effects: named, or in its group | {share} | {share} |" in text
    assert "nan" not in text
