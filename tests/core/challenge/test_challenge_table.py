"""The tables of the page about accuracy are those of their result file."""

from __future__ import annotations

import json

from ldt_core.docs import text
from tests.challenge_table import KEPT, table
from tests.page_table import with_table


def test_the_tables_are_those_of_the_result_file():
    """As `python -m tests.challenge_table` writes them."""
    found = json.loads(KEPT.read_text("utf-8"))
    assert with_table(text("accuracy"), table(found)) == text("accuracy")


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
    said = table({"sha256": "0", "cases": [case]})
    assert "named, or in a group of at most 3 | 0 % [0, 79] of 1" in said
    assert "the same excitation | 0 % [0, 79] of 1" in said  # a prediction that diverged
    assert "| 0.85 to 0.95 | 0.90 | 100 % [21, 100] of 1 |" in said
