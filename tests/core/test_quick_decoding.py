"""Records out of bytes at once are those that come of their messages; steps come in any order."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest
from fake_run import fake_run

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import (
    FAILED,
    Action,
    Adaptation,
    Experiment,
    Level,
    Prediction,
    Signal,
)
from ldt_core.recording import message_subject
from ldt_core.recording.bag import read_bag
from ldt_core.recording.codec import DECODERS, decode, decode_cdr, encode_cdr
from ldt_core.recording.flat_status import flat_status
from ldt_core.recording.messages import DIAGNOSTICS, deserialize
from ldt_core.views.report import reported_run
from ldt_core.views.report.reported_run import read_run
from ldt_core.views.step_view import StepCollector

ROW = np.linspace(1.0, 2.0, 7)
RECORDS = {
    "experiment": Experiment(3, 1e9, 0.01, ROW, 2 * ROW, 3 * ROW),
    "prediction": Prediction(3, 1e9, 0.01, 1, ROW, 0.1 * ROW),
    "signal": Signal(3, Level.POSITIVE, "thréshold", 0, 0.5, {"limit": 3.0}, "changed", 1.5),
    "adaptation": Adaptation(3, Action.ADAPTED, 1, "because", {"memory": 0.0}),
}


def outcome(make) -> object:
    """What comes out, or the error's kind and words."""
    try:
        record = make()
    except LdtError as error:
        return type(error), str(error)
    return {
        name: value.tobytes() if isinstance(value, np.ndarray) else repr(value)
        for name, value in vars(record).items()
    }


@pytest.mark.parametrize("topic", RECORDS)
def test_whatever_the_bytes_are_both_ways_say_the_same(topic):
    """Sound, cut, longer, or with a byte changed, before and behind others of the same layout."""
    kind, chance = DECODERS[topic][0], random.Random(1)
    good = encode_cdr(RECORDS[topic], "rotor", 1e9)
    tried = [good, good[:-1], good[:40], good + b"\0", b"", good]
    for at in range(len(good)):
        changed = bytearray(good)
        changed[at] ^= 1 << chance.randrange(8)
        tried.append(bytes(changed))
    for data in tried:
        quick = outcome(lambda data=data: decode_cdr(topic, kind, data))
        slow = outcome(lambda data=data: decode(topic, deserialize(data, kind, topic)))
        assert quick == slow
    assert kind != DIAGNOSTICS or flat_status(good) is not None


def test_what_many_records_have_in_common_is_held_once():
    """A page of 100,000 steps took 355 MB; what tells of a failure is kept all the same."""
    data = [encode_cdr(RECORDS["signal"]) for _ in range(2)]
    one, other = (decode_cdr("signal", DIAGNOSTICS, d) for d in data)
    texts = [(*s.statistics, s.detector, s.state) for s in (one, other)]
    assert all(a is b for a, b in zip(*texts, strict=True))
    collector = StepCollector(compared=False)
    for name in ("experiment", "prediction"):
        collector.take(name, RECORDS[name])
    step = collector.take("signal", one)
    done = RECORDS["adaptation"]
    for details, kept in (({"memory": 1.0}, {}), ({"memory": 1.0, FAILED: 1.0}, {FAILED: 1.0})):
        collector.take("adaptation", replace(done, details=details))
        assert step.adaptation == replace(done, details=kept)


@pytest.mark.parametrize("topic", RECORDS)
def test_what_a_message_is_about_is_the_same_both_ways(topic, monkeypatch):
    """Number and time, out of the bytes at once and of the whole message; mostly at once."""
    kind, chance = DECODERS[topic][0], random.Random(2)
    good = encode_cdr(RECORDS[topic], "rotor", 1e9)
    tried = [good, good[:-1], good[:40], good + b"\0", b""]
    for at in range(len(good)):
        changed = bytearray(good)
        changed[at] ^= 1 << chance.randrange(8)
        tried.append(bytes(changed))
    quick = [message_subject.said_of(topic, kind, data) for data in tried]
    assert quick[0] == (3, 1e9)
    for name in ("_head", "_status"):
        monkeypatch.setattr(message_subject, name, lambda data: None)
    slow = [message_subject.said_of(topic, kind, data) for data in tried]
    assert repr(quick) == repr(slow)


def test_steps_are_the_same_in_any_order(tmp_path):
    """Whichever of its records comes last; one that comes again is the one that counts."""
    bag = read_bag(fake_run(tmp_path / "run", range(1, 5)))
    records = [
        (raw.topic.rpartition("/")[2], record)
        for raw, record in bag.usable(bag.messages(*StepCollector.TOPICS))
    ]

    def rows(order) -> list[dict[str, object]]:
        collector = StepCollector(compared=True)
        steps = [step for name, record in order if (step := collector.take(name, record))]
        steps += collector.rest()
        return sorted((s.row() for s in steps), key=lambda row: row["number"])

    expected = rows(records)
    assert [row["number"] for row in expected] == [1, 2, 3, 4]
    for seed in range(20):
        mixed = list(records)
        random.Random(seed).shuffle(mixed)
        assert rows(mixed) == expected
    later = rows([*records, ("adaptation", Adaptation(4, Action.REFUSED, 0, "later"))])
    assert later == [*expected[:3], {**expected[3], "action": "refused", "reason": "later"}]


def test_the_worst_keep_their_samples_however_few_are_held(tmp_path, monkeypatch):
    """The same page, whether they were thinned at once or in the end."""
    run = fake_run(tmp_path / "run", range(1, 12), length=300)
    monkeypatch.setattr(reported_run, "room", lambda count, channels: (40, 3))
    pages = []
    for held in (0, 10**9):
        monkeypatch.setattr(reported_run, "MOST_HELD", held)
        read = read_run(run)
        pages.append([step.packed for step in read.steps])
        drawn = {step.number for step in read.steps if step.packed}
        assert drawn == {read.steps[i].number for i in read.worst_first[:3]}
    assert pages[0] == pages[1]
