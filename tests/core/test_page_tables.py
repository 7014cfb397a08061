"""The tables of the documentation's pages are those of their result files."""

from __future__ import annotations

import json

import pytest

from ldt_core.docs import text
from ldt_core.lab.study.robustness.alarm_trials import EVERY, over_seeds
from tests import (
    alarm_table,
    challenge_table,
    paper_table,
    robustness_table,
    threshold_sensitivity,
)
from tests.benchmarks import kept, measured_table
from tests.page_table import with_table


def content(file):
    return json.loads(file.read_text("utf-8"))


@pytest.mark.parametrize(
    ("page", "made"),
    [
        ("accuracy", lambda: challenge_table.table(content(challenge_table.KEPT))),
        ("detector", lambda: alarm_table.table(alarm_table.rows())),
        ("limits", lambda: threshold_sensitivity.table(content(threshold_sensitivity.KEPT))),
        ("paper", lambda: paper_table.table(paper_table.rows())),
        ("paper trials", lambda: paper_table.trial_table(paper_table.rows())),
        ("speed", lambda: kept.table(kept.load())),
        ("streams", lambda: robustness_table.table(robustness_table.rows(robustness_table.KEPT))),
    ],
)
def test_the_table_is_that_of_the_result_file(page, made):
    """As the command that the page names writes it."""
    page, _, name = page.partition(" ")
    assert with_table(text(page), made(), name) == text(page)


@pytest.mark.parametrize("name", measured_table.load())
def test_a_table_without_a_peer_is_that_of_its_result_file(name):
    """As `--keep` of its command writes it."""
    stored = measured_table.load()[name]
    page = text(stored["page"])
    assert with_table(page, measured_table.shown(stored), name) == page


def test_the_guarantee_holds_where_it_is_stated():
    """The upper end of the 95 % interval is below the stated rate."""
    totals = over_seeds(alarm_table.counts(alarm_table.rows()))
    stated = [c for c in totals if c.task.law and c.task.law not in alarm_table.OUTSIDE]
    assert len(stated) == 6
    for count in stated:
        share = alarm_table.false_alarms(count)
        assert share.count >= 20_000
        assert share.high <= 1 / EVERY, count.task.law
