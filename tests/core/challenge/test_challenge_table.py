"""The tables of the page about accuracy, and which cases they keep."""

from __future__ import annotations

import json

from tests.challenge_table import COLUMNS, kept, table


def test_a_group_of_four_is_no_name():
    """A single effect in a group of more than three names does not count as named."""
    case = {
        "who": "diagnosis",
        "case": "case_0001",
        "kind": "single",
        "right": True,
        "outcome": "group",
        "acting": [["a", "b", "c", "d"]],
        "confidence": 0.9,
        "nominal": None,
        "closure": {"same": {"promised": 0.9, "realised": None}},
        "seconds": 3.0,
    }
    said = table({"rounds": [{"sha256": "0", "cases": 1}], "cases": [case]})
    assert "named, or in a group of at most 3 | 0 % [0, 79] of 1" in said
    assert "the same excitation | 0 % [0, 79] of 1" in said  # a prediction that diverged
    assert "| 0.85 to 0.95 | 0.90 | 100 % [21, 100] of 1 |" in said


def test_comparators_stay_those_of_the_round_in_which_they_were_asked(tmp_path):
    """A round without them does not lose them; one with them keeps the cases they were asked."""
    for folder, asked in (("own", ["diagnosis"]), ("others", ["diagnosis", "greedy"])):
        rows = [{**dict.fromkeys(COLUMNS), "who": w, "case": c} for w in asked for c in "ab"]
        rows = [r for r in rows if r["who"] == "diagnosis" or r["case"] == "a"]
        (tmp_path / folder).mkdir()
        score = {"keys": [{"sha256": "0"}], "stamp": {}, "cases": rows}
        (tmp_path / folder / "score.json").write_text(json.dumps(score))
    before = {"compared": {"sha256": "1", "cases": []}}
    own, others = tmp_path / "own", tmp_path / "others"
    assert kept([own], before)["compared"] == before["compared"]
    anew = kept([own, others], before)
    assert anew["compared"]["sha256"] == "0"
    compared = [(c["who"], c["case"]) for c in anew["compared"]["cases"]]
    assert compared == [("diagnosis", "a"), ("greedy", "a")]
    assert [c["case"] for c in anew["cases"]] == ["a", "b"]
    assert kept([own, others], anew, add=True) == anew  # a round that is there already
    later = {**anew, "rounds": [{"sha256": "1", "cases": 2}]}
    more = kept([own], later, add=True)
    assert [c["case"] for c in more["cases"]] == ["a", "b", "a", "b"]
    assert [r["cases"] for r in more["rounds"]] == [2, 2]
