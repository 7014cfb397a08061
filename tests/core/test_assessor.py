"""What every detector's signal says of the model: its state and how far it is from the noise."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Experiment, Level, Prediction, Signal
from ldt_core.base.settings import resolve
from ldt_core.detectors.base import Detector
from ldt_core.recording import codec
from ldt_core.twin.detector_stage import Assessor, DetectorStage, build_detector_stage

LENGTH = 200


def pair(number, wave, version=0):
    """An experiment, and a prediction that is off by noise and by a wave of that height [rad/s]."""
    random = np.random.default_rng(number)
    speed = np.linspace(0.0, 30.0, LENGTH)
    off = random.normal(size=LENGTH) + wave * np.sin(np.linspace(0.0, 20.0, LENGTH))
    experiment = Experiment(number, 100.0 + number, 0.01, speed, speed + off)
    return experiment, Prediction(number, 100.0 + number, 0.01, version, speed)


def stage(detector="threshold", **settings):
    return build_detector_stage(resolve({"detector": detector, "threshold": 1e3, **settings}))


def test_a_detector_that_is_blind_says_all_the_same_that_the_model_does_not_hold():
    """Its word is negative throughout, by its own rule."""
    blind, seen = stage(), []
    for i in range(1, 11):
        seen.append(blind.step(*pair(i, 0 if i <= 5 else 5)))
    assert {s.level for s in seen} == {Level.NEGATIVE}
    assert [s.state for s in seen] == ["holds"] * 5 + ["changed"] * 5
    assert all((s.adequacy < 1.3) is (s.number <= 5) for s in seen)
    assert blind.step(*pair(11, 0)).state == "holds"


@pytest.mark.parametrize("detector", ["threshold", "lddm", "window", "never"])
def test_the_word_of_the_detector_stays_its_own(detector):
    """Bit for bit that of the detector alone."""
    beside = stage(detector, threshold=4.0, window=3)
    alone = beside.detector.clone()
    for i in range(1, 31):
        experiment, prediction = pair(i, i % 7)
        signal = beside.step(experiment, prediction)
        if alone.drift_detected:
            alone.answered(False)
        alone.update(prediction.residual(experiment))
        assert signal.level is alone.signal
        assert beside.detector.state() == alone.state()


def test_learning_that_did_not_help_is_said_and_a_new_model_begins_anew():
    """After a positive of the detector's own, whose word nobody took for an answer before."""
    seeing = stage(threshold=5.0)
    states = [seeing.step(*pair(i, 8)).state for i in range(1, 5)]
    assert states == ["changed", "inadequate", "inadequate", "inadequate"]
    assert seeing.step(*pair(5, 0, version=1)).state == "holds"
    assert seeing.step(*pair(6, 8, version=1)).state == "changed"


def test_a_version_that_comes_at_a_warning_is_judged_anew():
    """What was tried in vain with the one before says nothing about it."""
    seeing = stage("adequacy")
    levels = [seeing.step(*pair(i, 5)).level for i in range(1, 4)]
    assert levels == [Level.POSITIVE, Level.POSITIVE, Level.WARNING]
    signal = seeing.step(*pair(4, 5, version=1))
    assert (signal.level, signal.state) == (Level.POSITIVE, "changed")


def test_a_false_alarm_of_the_detector_does_not_make_the_model_inadequate():
    """It was explained, and stays so."""
    calendar = stage("window", window=1)
    assert {calendar.step(*pair(i, 0)).state for i in range(1, 30)} == {"holds"}


def test_a_restart_goes_on_to_the_last_bit():
    """The assessor's state is part of the stage's."""
    throughout, waves = stage(threshold=6.0), [0, 0, 0.4, 0.5, 8, 8, 0.7, 8, 0, 0.4, 9, 0]
    for i, wave in enumerate(waves, start=1):
        again = stage(threshold=6.0)
        again.return_to(json.loads(json.dumps(throughout.state())), None)
        signal = throughout.step(*pair(i, wave))
        assert signal == again.step(*pair(i, wave))
        assert again.state() == throughout.state()


def test_a_state_without_the_assessors_is_refused():
    """A checkpoint of an older version: the recording decides, from the beginning."""
    old = stage()
    state = old.state()
    del state["assessor"]
    with pytest.raises(OptionError, match="'assessor'"):
        old.return_to(state, None)


class Judging(Detector):
    """A user's own that judges the model itself."""

    name = "judging"

    def __init__(self):
        self.reset()

    def judge(self, residual, deviation):
        self.model_state, self.adequacy = "new_range", 7.0
        return Level.NEGATIVE


def test_what_a_users_detector_says_itself_comes_first():
    """The assessor is silent beside it."""
    signal = DetectorStage("judging", Judging(), Assessor()).step(*pair(1, 8))
    assert (signal.state, signal.adequacy) == ("new_range", 7.0)


@pytest.mark.parametrize(("state", "adequacy"), [("", None), ("learning", None), ("holds", 1.25)])
def test_every_signal_message_has_both(state, adequacy):
    """Empty while unknown; both come back."""
    signal = Signal(3, Level.NEGATIVE, "never", 0, 0.5, {"rate": 0.5}, state, adequacy)
    message = codec.encode(signal)
    values = {pair.key: pair.value for pair in message.status[0].values}
    assert values["state"] == state
    assert values["adequacy"] == ("" if adequacy is None else repr(adequacy))
    assert codec.decode("signal", message) == signal
    message.status[0].values = [p for p in message.status[0].values if p.key not in JUDGED]
    assert codec.decode("signal", message).state == ""


JUDGED = ("state", "adequacy")
