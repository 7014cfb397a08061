"""An estimate in a table."""

from __future__ import annotations

from ldt_core.base.sentences import number
from ldt_core.lab.study.statistics import Estimate
from ldt_core.views.page.blocks import Cell, Value


def cell(estimate: Estimate, digits: int = 3, scale: float = 1.0) -> Value:
    """A figure with its interval below it."""
    if estimate.value is None:
        return "–"
    text = number(estimate.value * scale, digits)
    if estimate.count < 2:
        return Cell(text, "one seed")
    low, high = number(estimate.low * scale, digits), number(estimate.high * scale, digits)
    return Cell(text, f"{low} to {high}")
