"""What a client of `ldt serve` gets of a running graph: each sample once, with its predictions."""

from __future__ import annotations

import dataclasses
import math
import threading
from itertools import pairwise

import numpy as np
import pytest

from ldt_core.base.experiment import Experiment, Level, Prediction, Signal
from ldt_core.recording.messages import deserialize

pytest.importorskip("foxglove")

from ldt_core.views.export import foxglove_relay
from ldt_core.views.export.foxglove_relay import KIND, FoxgloveRelay

LENGTH = 50


def measured(number: int) -> Experiment:
    speed = np.full(LENGTH, float(number))
    return Experiment(number, 1e9 + number, 0.01, np.ones(LENGTH), speed)


def predicted(number: int, value: float) -> Prediction:
    e = measured(number)
    return Prediction(number, e.start, e.period, 1, np.full(LENGTH, value))


def judged(number: int) -> Signal:
    return Signal(number, Level.NEGATIVE, "adequacy", 1, 0.1)


class Relay(FoxgloveRelay):
    """Keeps what it would send, and is at the time that a test says."""

    def __init__(self) -> None:
        super().__init__(True, "127.0.0.1", 0, "test")
        self.sent: list[tuple[str, float, bytes]] = []
        self.now = 0.0
        self._clock = lambda: self.now

    def _send(self, topic, kind, data, moment) -> None:
        self.sent.append((topic, moment, data))

    def tick(self) -> None:
        """One round of the thread that sends samples."""
        stop = threading.Event()
        rounds = iter((False, True))
        stop.wait = lambda _: next(rounds)  # type: ignore[method-assign]
        self.play(lambda: None, stop)

    def joints(self) -> list:
        return [deserialize(d, KIND, "sent") for t, _, d in self.sent if t == "/joint_states"]


@pytest.fixture
def relay():
    made = Relay()
    yield made
    made.stop()


def test_samples_wait_for_their_predictions_and_are_sent_once(relay):
    """What is still said of the experiment before does not send them early."""
    relay.feed("", "experiment", measured(2))
    relay.feed("", "signal", judged(1))
    relay.tick()
    assert relay.joints() == []
    relay.feed("", "original_prediction", predicted(2, 8.0))
    relay.tick()
    assert relay.joints() == []
    relay.feed("", "prediction", predicted(2, 5.0))
    relay.tick()
    relay.feed("", "signal", judged(2))
    relay.feed("", "experiment", measured(3))
    relay.tick()
    joints = relay.joints()
    assert [j.velocity.tolist() for j in joints] == [[2.0, 5.0, 8.0]] * LENGTH
    times = [moment for topic, moment, _ in relay.sent if topic == "/joint_states"]
    assert all(a < b for a, b in pairwise(times))


def test_a_late_prediction_does_not_send_the_samples_again(relay):
    """After the patience they go out as measured, and curves do not go back in time."""
    relay.feed("", "experiment", measured(1))
    relay.now = foxglove_relay.PATIENCE + 1
    relay.tick()
    relay.feed("", "prediction", predicted(1, 5.0))
    relay.feed("", "signal", judged(1))
    relay.tick()
    assert [j.velocity.tolist() for j in relay.joints()] == [[1.0]] * LENGTH


def test_a_twin_that_is_behind_gets_its_curves_in_order(relay):
    """Experiments that come meanwhile wait, and go out in their order."""
    relay.feed("", "prediction", predicted(1, 5.0))  # no order is promised between topics
    for number in (1, 2, 3):
        relay.feed("", "experiment", measured(number))
    for number in (2, 1, 3):
        if number > 1:
            relay.feed("", "prediction", predicted(number, 5.0))
        relay.feed("", "original_prediction", predicted(number, 8.0))
    joints = relay.joints()
    assert [len(j.velocity) for j in joints] == [3] * 3 * LENGTH
    assert [j.velocity[0] for j in joints] == sorted(j.velocity[0] for j in joints)


def test_the_original_keeps_its_place_where_the_twin_is_silent(relay):
    """A layout names a joint by its place; the twin's is not a number there."""
    relay.feed("", "experiment", measured(1))
    relay.feed("", "original_prediction", predicted(1, 8.0))
    relay.now = foxglove_relay.PATIENCE + 1
    relay.tick()
    first = relay.joints()[0]
    assert first.name == ["machine", "predicted", "original"]
    assert (first.velocity[0], first.velocity[2]) == (1.0, 8.0)
    assert math.isnan(first.velocity[1])


def test_what_a_machine_streams_is_sent_on_at_once(relay):
    """And not again when the experiment is whole; its predictions are."""
    relay.expect("")
    relay.sample("", 1e9 + 1, 0.5)
    assert [j.velocity.tolist() for j in relay.joints()] == [[0.5]]
    relay.feed("", "experiment", measured(1))
    relay.feed("", "prediction", predicted(1, 5.0))
    relay.now = foxglove_relay.PATIENCE + 1
    relay.tick()
    first = relay.joints()[1]
    assert math.isnan(first.velocity[0])
    assert first.velocity[1] == 5.0
    relay.feed("", "experiment", measured(2))
    relay.now *= 3
    relay.tick()
    assert len(relay.joints()) == 1 + LENGTH
    assert sum(topic == "/voltage" for topic, _, _ in relay.sent) == 2 * LENGTH


@pytest.mark.parametrize("moment", [-1.0, 1e300])
def test_a_time_that_no_stamp_holds_is_sent_on(relay, moment):
    """It is held at the ends of what a stamp can say."""
    relay.feed("", "experiment", dataclasses.replace(measured(1), start=moment))
    relay.now = foxglove_relay.PATIENCE + 1
    relay.tick()
    assert len(relay.joints()) == LENGTH
    FoxgloveRelay._send(relay, "/joint_states", KIND, relay.sent[-1][2], moment)
