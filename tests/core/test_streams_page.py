"""The table of the page about other machines is that of its result file."""

from __future__ import annotations

from ldt_core.docs import text
from tests.page_table import with_table
from tests.robustness_table import KEPT, rows, table


def test_the_table_is_that_of_the_result_file():
    """As `python -m tests.robustness_table` writes it."""
    assert with_table(text("streams"), table(rows(KEPT))) == text("streams")
