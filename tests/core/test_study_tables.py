"""A study as tables."""

from __future__ import annotations

import csv
from dataclasses import replace

from study_results import made_up

from ldt_core.lab.study.baselines import baseline_cases
from ldt_core.lab.study.study import Entry, Study
from ldt_core.lab.study.study_tables import COLUMNS, summary_rows, table_rows, write_tables

TRUTH = [0.0] * 10 + [0.001] * 10


def study() -> Study:
    """Two seeds under a detector of the paper, one better run, and a baseline."""
    paper = [
        made_up(TRUTH, [11, 20], seed=seed, max_error=1.0 + seed, original=4.0) for seed in (0, 1)
    ]
    quiet = made_up(TRUTH, model="diagnosed", detector="adequacy", seed=0, original=4.0)
    (case, _) = baseline_cases(paper[0])
    baseline = replace(paper[0], case=case)
    entries = [*(Entry(r, ("paper", "sweep")) for r in paper), Entry(quiet, ("better",))]
    beside = Entry(baseline, ("baseline",), (paper[0].case.key,))
    return Study({}, (*entries, beside))


def read(file):
    return list(csv.DictReader(file.read_text().splitlines()))


def test_the_table_has_the_agreed_columns_and_one_row_a_run(tmp_path):
    """Of the groups paper and better; what is undefined is empty."""
    write_tables(tmp_path, study())
    assert (tmp_path / "table.csv").read_text().splitlines()[0] == (
        "model,detector,seed,mme,mme_original,adaptations,precision,recall"
    )
    rows = read(tmp_path / "table.csv")
    assert [(r["model"], r["detector"], r["seed"]) for r in rows] == [
        ("hybrid", "threshold", "0"),
        ("hybrid", "threshold", "1"),
        ("diagnosed", "adequacy", "0"),
    ]
    assert [float(r["mme"]) for r in rows] == [1.0, 2.0, 1.0]
    assert (rows[0]["precision"], rows[0]["recall"], rows[0]["adaptations"]) == ("0.5", "1.0", "2")
    assert (rows[2]["precision"], rows[2]["recall"]) == ("", "0.0")


def test_all_runs_are_in_the_other_table(tmp_path):
    """With group and settings; and the original model once a stream."""
    write_tables(tmp_path, study())
    rows = read(tmp_path / "runs.csv")
    assert [r["groups"] for r in rows][:4] == ["paper sweep", "paper sweep", "better", "baseline"]
    assert rows[0]["threshold"] == "3.0"
    assert (rows[3]["detector"], rows[3]["threshold"]) == ("periodic", "")
    assert rows[3]["beside"] == rows[0]["key"]
    original = [r for r in rows if r["model"] == "original"]
    assert [(r["detector"], r["seed"], r["mme"]) for r in original] == [
        ("never", "0", "4.0"),
        ("never", "1", "4.0"),
    ]
    assert {r["adaptations"] for r in original} == {"0"}


def test_the_summary_stands_beside_the_papers_table():
    """Mean and interval over seeds; the paper's figures only beside what repeats the paper."""
    paper, better = summary_rows(study())
    assert (paper["model"], paper["seeds"]) == ("hybrid", 2)
    assert paper["mme"]["value"] == 1.5
    assert paper["mme"]["low"] < 1 < 2 < paper["mme"]["high"]
    assert paper["share"]["value"] == 1.5 / 4
    assert (paper["paper"]["mme"], paper["paper"]["adaptations"]) == (6.86, 25)
    assert better["paper"] is None
    assert better["precision"]["value"] is None


def test_a_row_of_the_table_has_plain_numbers():
    """For JSON as well."""
    for row in table_rows(study()):
        assert tuple(row) == COLUMNS
        assert all(isinstance(v, int | float | str | None) for v in row.values())
