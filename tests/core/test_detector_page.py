"""The tables of the page about the detector are those of their result file."""

from __future__ import annotations

import pytest

from ldt_core.docs import text
from ldt_core.lab.study.robustness.alarm_trials import EVERY, LAWS_IN_CONTROL
from tests.alarm_table import KEPT, OUTSIDE, counts, false_alarms, rows, table
from tests.page_table import with_table


def test_the_table_is_that_of_the_result_file():
    """As `python -m tests.alarm_table` writes it."""
    assert with_table(text("detector"), table(rows(KEPT))) == text("detector")


@pytest.mark.parametrize("law", [law for law in LAWS_IN_CONTROL if law not in OUTSIDE])
def test_the_guarantee_holds_where_it_is_stated(law):
    """The upper end of the 95 % interval is below the stated rate."""
    share = false_alarms(counts(rows(KEPT)), law)
    assert share.count >= 20_000
    assert share.high <= 1 / EVERY
