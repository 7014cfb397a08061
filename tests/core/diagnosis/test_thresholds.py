"""Claims about the thresholds of the decision."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, fields

import pytest

from ldt_core.diagnosis.thresholds import THRESHOLDS


@pytest.mark.parametrize("threshold", fields(THRESHOLDS), ids=lambda f: f.name)
def test_every_threshold_has_a_unit_a_reason_and_a_source(threshold):
    """So that a reader knows what it limits, why, and where the number is from."""
    assert isinstance(threshold.default, (int, float))
    assert set(threshold.metadata) == {"unit", "reason", "source"}
    assert all(isinstance(text, str) and text.strip() for text in threshold.metadata.values())


def test_no_threshold_changes_during_a_diagnosis():
    """They are the same for all decisions of a process."""
    with pytest.raises(FrozenInstanceError):
        THRESHOLDS.law_error = 0.1
