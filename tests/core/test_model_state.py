"""What people are told of a signal: never that a model holds whose error is not noise."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.base.experiment import Level, Signal
from ldt_core.base.model_state import DOUBTED, NOT_JUDGED, STATES, shown_state, times_noise


def signal(state: str, adequacy: float | None, level: Level = Level.NEGATIVE) -> Signal:
    return Signal(1, level, "mine", 0, 2.0, {}, state, adequacy)


@given(st.sampled_from([*STATES, "", "fine"]), st.floats(min_value=DOUBTED), st.sampled_from(Level))
def test_nothing_is_green_from_ten_times_the_noise_on(state, adequacy, level):
    """Whatever the recording says, infinity included."""
    assert shown_state(signal(state, adequacy, level)).tone != "good"


@pytest.mark.parametrize("adequacy", [float("nan"), -1.0])
def test_an_error_that_is_none_is_not_believed(adequacy):
    """A foreign recording may hold any number."""
    assert shown_state(signal("holds", adequacy)) is NOT_JUDGED
    assert shown_state(signal("changed", adequacy)).words == "machine changed"


@pytest.mark.parametrize("state", ["", "fine", "HOLDS"])
def test_a_state_that_nobody_knows_is_not_judged(state):
    """Grey and in words, also of a negative signal."""
    assert shown_state(signal(state, 1.0)) is NOT_JUDGED
    assert (NOT_JUDGED.words, NOT_JUDGED.tone) == ("not judged", "open")


def test_only_a_model_that_holds_is_green():
    """Each state has words of its own; inadequate is said to be no good."""
    assert {name for name, s in STATES.items() if s.tone == "good"} == {"holds"}
    assert len({s.words for s in STATES.values()}) == len(STATES) == 5
    assert STATES["inadequate"].words == "model inadequate: the best known, not good"
    assert [times_noise(a) for a in (float("inf"), 1200.4)] == ["", "1200 times the noise"]
