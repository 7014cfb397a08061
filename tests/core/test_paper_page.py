"""The tables of the page about the paper are those of their result file."""

from __future__ import annotations

import pytest

from ldt_core.docs import text
from tests.page_table import with_table
from tests.paper_table import rows, table, trial_table


@pytest.mark.parametrize(("name", "made"), [("", table), ("trials", trial_table)])
def test_the_table_is_that_of_the_result_file(name, made):
    """As `python -m tests.paper_table` writes it."""
    assert with_table(text("paper"), made(rows()), name) == text("paper")
