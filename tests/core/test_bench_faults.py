"""The default twin on a motor that is recorded with the faults of a test bench."""

from __future__ import annotations

import numpy as np
import pytest

from tests.bench_faults import CHANGES, EXPERIMENTS, FAULTS, after_the_change, experiments

HALF = EXPERIMENTS // 2


@pytest.mark.parametrize("change", CHANGES)
def test_the_motor_changes_half_way(change):
    """Not before; and the same voltages move it otherwise after that."""
    same, changed = experiments("none", "gravity", 1), experiments("none", change, 1)
    if change != "again":
        assert all(
            np.array_equal(a.speed, b.speed) for a, b in zip(same[:HALF], changed, strict=False)
        )
    again = experiments("none", change, 1)
    assert all(np.array_equal(a.speed, b.speed) for a, b in zip(again, changed, strict=True))


@pytest.mark.parametrize("fault", [f for f in FAULTS if f != "none"])
def test_a_fault_shows_from_the_first_experiment_on(fault):
    """In the voltage or in the speed, by more than another draw of the noise."""
    (plain, *_), (shown, *_) = experiments("none", "dry", 1), experiments(fault, "dry", 1)
    moved = np.abs(shown.speed - plain.speed).max() + np.abs(shown.voltage - plain.voltage).max()
    assert moved > 0.2


@pytest.mark.slow
def test_no_cause_of_one_experiment_replaces_what_was_right_before():
    """A filter and a drag that no law describes: 12 % were left where causes came and went."""
    twin, original = after_the_change("filter", "cubic", 1)
    assert twin < 0.09 * original
