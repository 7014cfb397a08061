"""A positive from which no new model came: what it was raised for does not become usual."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ldt_core.base.experiment import Level
from ldt_core.detectors.foreign import Foreign
from ldt_core.detectors.lddm import LDDM
from ldt_core.detectors.threshold import Threshold
from ldt_core.detectors.window import Window

SAMPLES = 100


def stream(scales):
    """Residuals of these scales [rad/s]."""
    random = np.random.default_rng(3)
    return [scale * random.standard_normal(SAMPLES) for scale in scales]


class Rise:
    """By river's convention, and as its detectors: it starts anew after a drift by itself."""

    def __init__(self):
        self.usual, self.drift_detected = None, False

    def update(self, x):
        if self.drift_detected or self.usual is None:
            self.usual, self.drift_detected = x, False
        self.drift_detected = x > 3 * self.usual


def river():
    pytest.importorskip("river")
    from ldt_core.detectors.river_adapter import River

    return River("PageHinkley", min_instances=5, threshold=5.0)


MADE = {
    "lddm": lambda: LDDM(error_threshold=3.5),
    "threshold": lambda: Threshold(10.0),
    "object": lambda: Foreign(Rise()),
    "river": river,
}


@pytest.mark.parametrize("name", MADE)
def test_it_stays_positive_until_the_machine_is_as_before(name):
    """Bad experiments for long, without a new model; then good ones."""
    detector, words = MADE[name](), []
    for residual in stream([1.0] * 10 + [20.0] * 20 + [1.0] * 5):
        detector.update(residual)
        words.append(detector.signal)
        if detector.drift_detected:
            detector.answered(False)
    assert words[10:30] == [Level.POSITIVE] * 20
    assert Level.POSITIVE not in words[30:]


@pytest.mark.parametrize("name", MADE)
def test_after_a_new_model_it_starts_anew(name):
    """As one that has seen nothing."""
    detector, fresh = MADE[name](), MADE[name]()
    for residual in stream([1.0] * 10 + [20.0]):
        detector.update(residual)
    assert detector.drift_detected
    detector.answered(True)
    for residual in stream([20.0] * 3):
        detector.update(residual)
        fresh.update(residual)
        assert detector.signal is fresh.signal
        assert detector.statistics == fresh.statistics


@pytest.mark.parametrize("name", ["lddm", "river"])
def test_a_restart_between_positive_and_answer_changes_nothing(name):
    """What is taken back is part of the state."""
    detector = MADE[name]()
    for residual in stream([1.0] * 10 + [20.0]):
        detector.update(residual)
    again = MADE[name]()
    again.restore(json.loads(json.dumps(detector.state())))
    for residual in stream([20.0, 20.0, 1.0]):
        for one in (detector, again):
            one.answered(False)
            one.update(residual)
        assert again.state() == detector.state()


def test_a_window_ends_all_the_same():
    """It goes by the calendar."""
    window, words = Window(3), []
    for residual in stream([1.0] * 7):
        window.update(residual)
        words.append(window.drift_detected)
        window.answered(False) if window.drift_detected else None
    assert words == [False, False, True, False, False, True, False]
