"""What the live page shows, without web and without ROS: true, worst first, bounded."""

from __future__ import annotations

import json
import math
import threading
import time

import numpy as np
import pytest
from fake_run import fake_run
from hypothesis import given
from hypothesis import strategies as st
from unpacked import unpack
from watched import HOSTILE, LENGTH, feed, health, measured, predicted

from ldt_core.base.errors import OptionError, RecordingError
from ldt_core.base.experiment import Level, ModelRecord, Prediction, Signal
from ldt_core.base.model_state import STATES
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import BagWriter
from ldt_core.views.packed_samples import PackedChannel, PackedSamples
from ldt_core.views.watch.fleet import MACHINES, Fleet
from ldt_core.views.watch.playback_clock import PlaybackClock
from ldt_core.views.watch.record_source import Playback
from ldt_core.views.watch.watched_machine import (
    GREATEST,
    LONGEST,
    MOST_CHARACTERS,
    MOST_EVENTS,
    MOST_MODELS,
    MOST_NODES,
    MOST_SAMPLES,
    MOST_STEPS,
    SILENT_AFTER,
    WHOLE_STEPS,
)


class Clock:
    """Time that passes when it is told to."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def rows_of(found: dict) -> dict[str, np.ndarray]:
    channels = tuple(PackedChannel(*c) for c in found["channels"])
    return unpack(PackedSamples(channels, found["data"], found["kept"], found["of"]))


def test_an_experiment_is_shown_as_it_arrives():
    """First measured, then predicted with its band, then judged; each step is told."""
    fleet, one = Fleet(), measured(1)
    told: list[int] = []
    fleet.on_change = lambda: told.append(fleet.count)
    fleet.feed("/press", "experiment", one)
    rows = rows_of(fleet.experiment("/press", 1))
    assert set(rows) == {"time", "voltage", "measured"}
    np.testing.assert_allclose(rows["measured"], one.speed, atol=1e-4)
    assert fleet.machine("/press")["steps"][0]["level"] is None
    fleet.feed("/press", "prediction", predicted(one, 4.0))
    rows = rows_of(fleet.experiment("/press", 1))
    assert {"predicted", "deviation"} <= set(rows)
    assert np.abs(rows["measured"] - rows["predicted"]).max() == pytest.approx(4.0, abs=1e-3)
    fleet.feed("/press", "signal", Signal(1, Level.POSITIVE, "threshold", 0, 4.0))
    step = fleet.machine("/press")["steps"][0]
    assert (step["error"], step["level"], step["value"]) == (4.0, 1, 4.0)
    assert fleet.overview()["machines"][0]["word"] == "positive"
    assert told == [1, 2, 3]


def test_only_what_has_changed_is_told_again():
    """By the count that came with what was told before; 0 tells all."""
    fleet = Fleet()
    for number in (1, 2, 3):
        feed(fleet, "", number, level=Level.POSITIVE)
    whole = fleet.machine("/")
    assert whole["whole"]
    assert [t["number"] for t in whole["steps"]] == [1, 2, 3]
    kinds = [kind for *_, kind, _ in whole["events"]]
    assert kinds == ["model", "diagnosis", "adapted"] * 3
    assert whole["diagnosis"]["sentence"] == "It is unbalance."
    feed(fleet, "", 4)
    news = fleet.machine("/", whole["count"])
    assert not news["whole"]
    assert [t["number"] for t in news["steps"]] == [4]
    assert news["numbers"] == [1, 2, 3, 4]
    assert news["events"] == []
    assert "diagnosis" not in news
    assert fleet.machine("/", news["count"])["steps"] == []


def test_the_worst_machine_comes_first():
    """Positive, then fallen silent, then warning, then negative, then nothing yet."""
    clock = Clock()
    fleet = Fleet(clock=clock)
    fleet.expect("/new")
    feed(fleet, "/good", 1, 0.5)
    feed(fleet, "/lost", 1, 0.4)
    feed(fleet, "/warned", 1, 4.0, Level.WARNING)
    feed(fleet, "/bad", 1, 7.0, Level.POSITIVE)
    feed(fleet, "/worse", 1, 9.0, Level.POSITIVE)
    fleet.feed("", "/diagnostics", health("lost/twin"))
    clock.now += SILENT_AFTER + 1
    fleet.feed("", "/diagnostics", health("good/twin"))
    cards = fleet.overview()["machines"]
    order = ["/worse", "/bad", "/lost", "/warned", "/good", "/new"]
    assert [c["key"] for c in cards] == order
    assert cards[2]["trouble"] == "silent: twin"
    assert cards[0]["age"] == SILENT_AFTER + 1


@pytest.mark.parametrize("state", STATES.values(), ids=STATES)
def test_the_lamp_is_the_state(state):
    """In words and colour with the error over the noise; the signal's word stays beside it."""
    fleet = Fleet()
    feed(fleet, "", 1, state=state.name, adequacy=3.24)
    (card,) = fleet.overview()["machines"]
    assert (card["state"], card["words"], card["tone"]) == (state.name, state.words, state.tone)
    assert (card["word"], card["noise"]) == ("negative", "3.2 times the noise")
    step = fleet.machine("/")["steps"][0]
    assert (step["state"], step["noise"]) == (state.name, 3.24)


@pytest.mark.parametrize(("state", "adequacy"), [("", None), ("holds", 10.0), ("fine", 1.0)])
def test_the_lamp_is_never_green_unless_the_model_is_known_to_hold(state, adequacy):
    """Negative is no assurance."""
    fleet = Fleet()
    feed(fleet, "", 1, state=state, adequacy=adequacy)
    (card,) = fleet.overview()["machines"]
    assert (card["words"], card["tone"], card["word"]) == ("not judged", "open", "negative")


def test_a_model_that_is_no_good_comes_before_one_that_holds():
    """Also where the detector is negative of both: changed, inadequate, learning, holds."""
    fleet = Fleet()
    for name in ("holds", "inadequate", "learning", "changed"):
        feed(fleet, f"/{name}", 1, state=name, adequacy=1.0)
    order = [card["key"] for card in fleet.overview()["machines"]]
    assert order == ["/changed", "/inadequate", "/learning", "/holds"]


def test_the_trouble_of_a_graph_goes_with_it():
    """A line about a full disk would stand there for days, beside "not running"."""
    clock = Clock()
    fleet = Fleet(True, clock)
    feed(fleet, "", 1)
    fleet.feed("", "/diagnostics", health("recorder", message="the disk is full"))
    fleet.feed("", "/diagnostics", health("plant", stopped="true"))
    assert fleet.overview()["machines"][0]["trouble"] == "recorder: the disk is full"
    clock.now += SILENT_AFTER + 1
    assert fleet.overview()["machines"][0]["trouble"] == ""
    assert not any(node["warns"] for node in fleet.machine("/")["nodes"])


def test_a_graph_that_has_ended_is_not_in_trouble():
    """Nor is one that is played back: its nodes are not there."""
    clock = Clock()
    for live, finished, silent in ((True, "true", []), (True, "false", ["twin"]), (False, "", [])):
        fleet = Fleet(live, clock)
        feed(fleet, "", 1)
        fleet.feed("", "/diagnostics", health("twin"))
        fleet.feed("", "/diagnostics", health("plant", finished=finished))
        clock.now += SILENT_AFTER + 1
        fleet.feed("", "/diagnostics", health("plant", finished=finished))
        trouble = fleet.overview()["machines"][0]["trouble"]
        assert trouble == "".join(f"silent: {s}" for s in silent)


def test_a_graph_that_was_stopped_is_not_in_trouble():
    """Its source tells that it ends without having finished."""
    clock = Clock()
    fleet = Fleet(True, clock)
    feed(fleet, "", 1)
    fleet.feed("", "/diagnostics", health("twin"))
    fleet.feed("", "/diagnostics", health("plant", stopped="true"))
    clock.now += SILENT_AFTER + 1
    assert fleet.overview()["machines"][0]["trouble"] == ""


@pytest.mark.parametrize("stopped", ["true", "false"])
def test_the_lamp_is_dark_while_nothing_runs(stopped):
    """A graph that was stopped, or killed, on Friday is not green on Monday."""
    clock = Clock()
    fleet = Fleet(True, clock)
    feed(fleet, "", 1, state="holds", adequacy=1.0)
    for name in ("twin", "plant"):
        fleet.feed("", "/diagnostics", health(name, stopped=stopped, process="7"))
    (card,) = fleet.overview()["machines"]
    assert (card["words"], card["tone"]) == ("model holds", "good")
    clock.now += SILENT_AFTER + 1
    (card,) = fleet.overview()["machines"]
    assert (card["words"], card["tone"]) == ("not running; last: model holds", "open")
    ended = {"true": "ended", "false": "running"}[stopped]
    assert [n["message"] for n in fleet.machine("/")["nodes"]] == [ended] * 2
    fleet.feed("", "/diagnostics", health("twin", process="8"))
    (card,) = fleet.overview()["machines"]
    assert (card["words"], card["tone"]) == ("model holds", "good")


@pytest.mark.parametrize("pause", [0, SILENT_AFTER + 1])
def test_the_nodes_of_a_run_that_has_ended_are_not_missed_in_the_next(pause):
    """A diagnoser of the first run was silent for as long as the second one went on."""
    clock = Clock()
    fleet = Fleet(True, clock)
    feed(fleet, "", 1)
    for name in ("diagnoser", "twin", "plant"):
        fleet.feed("", "/diagnostics", health(name, finished="true", process=f"1{len(name)}"))
    clock.now += pause
    for _ in range(2):  # each second
        for name in ("plant", "detector", "twin"):
            fleet.feed("", "/diagnostics", health(name, process=f"2{len(name)}"))
        clock.now += SILENT_AFTER - 1
    (card,) = fleet.overview()["machines"]
    assert card["trouble"] == ""
    assert [n["role"] for n in fleet.machine("/")["nodes"]] == ["detector", "plant", "twin"]


def test_the_nodes_of_a_machine_are_told_apart_from_others():
    """By namespace, and by what only the twin's nodes tell; what was refused is shown."""
    fleet = Fleet()
    feed(fleet, "/a", 1)
    refused = {"rejected experiment: ExperimentError": "2", "last_rejection": f"why{HOSTILE}"}
    fleet.feed("", "/diagnostics", health("a/twin", message="2 messages rejected", **refused))
    fleet.feed("", "/diagnostics", health("b/twin"))
    foreign = health("a/lidar")
    foreign.status[0].values.clear()
    fleet.feed("", "/diagnostics", foreign)
    (node,) = fleet.machine("/a")["nodes"]
    assert (node["role"], node["warns"]) == ("twin", True)
    assert node["rejected"] == "2 × experiment: ExperimentError"
    assert node["why"] == f"why{HOSTILE}"
    assert fleet.overview()["machines"][0]["trouble"] == "twin: 2 messages rejected"
    for k in range(2 * MOST_NODES):
        fleet.feed("", "/diagnostics", health(f"a/node_{k}"))
    assert len(fleet.machine("/a")["nodes"]) == MOST_NODES


@pytest.mark.parametrize("whole", [WHOLE_STEPS, 10])
def test_memory_is_bounded_whatever_comes(whole, monkeypatch):
    """Experiments, samples, events, versions, texts, machines."""
    monkeypatch.setattr("ldt_core.views.watch.watched_machine.MOST_WHOLE", LENGTH * whole)
    fleet = Fleet()
    for number in range(1, MOST_STEPS + 30):
        feed(fleet, "", number, level=Level.POSITIVE, words="x" * 2 * MOST_CHARACTERS)
    state = fleet.machines[""]
    assert len(state.steps) == MOST_STEPS
    assert min(state.steps) == 30
    assert len(state.models) == MOST_MODELS
    assert len(state.events) == MOST_EVENTS
    assert sum(t.experiment is not None for t in state.steps.values()) == whole
    told = fleet.machine("/")
    assert max(len(words) for *_, words in told["events"]) == MOST_CHARACTERS
    assert len(told["steps"][0]["reason"]) == MOST_CHARACTERS
    for k in range(3 * MACHINES):
        fleet.expect(f"/m{k}")
    assert len(fleet.overview()["machines"]) == MACHINES
    assert fleet.overview()["left"] == MACHINES


def test_a_long_experiment_is_thinned_with_its_extremes():
    """At once and later; one that nobody could show is refused and counted."""
    fleet, long = Fleet(), measured(1, length=50_000)
    fleet.feed("", "experiment", long)
    fleet.feed("", "prediction", predicted(long, 9.0))
    now = fleet.experiment("/", 1)
    for number in range(2, 2 + WHOLE_STEPS):
        feed(fleet, "", number, start=long.end + number)
    for found in (now, fleet.experiment("/", 1)):
        assert found["kept"] <= MOST_SAMPLES < found["of"]
        rows = rows_of(found)
        assert np.abs(rows["measured"] - rows["predicted"]).max() == pytest.approx(9.0, abs=1e-3)
    fleet.feed("", "experiment", measured(90, length=LONGEST + 1))
    assert 90 not in fleet.machines[""].steps
    assert "samples to show" in fleet.machine("/")["last_unreadable"]


def test_a_number_that_a_browser_cannot_count_is_refused():
    """It would stay the newest for ever."""
    fleet = Fleet()
    for number in (GREATEST * 10, GREATEST + 1):
        fleet.feed("", "signal", Signal(number, Level.POSITIVE, "threshold", 0, 1.0))
    fleet.feed("", "model", ModelRecord(GREATEST + 1, "kind", (), {}))
    assert fleet.machine("/")["numbers"] == []
    assert fleet.machine("/")["unreadable"] == 3


def test_a_run_that_begins_anew_takes_the_place_of_the_old():
    """A graph that was started again counts from 1; the page is told to forget."""
    fleet = Fleet()
    for number in (1, 2, 3):
        feed(fleet, "", number, level=Level.POSITIVE)
    before = fleet.machine("/")["count"]
    later = measured(3).end + 50
    feed(fleet, "", 1, start=later)
    news = fleet.machine("/", before)
    assert news["whole"]
    assert news["numbers"] == [1]
    assert news["diagnosis"] is None
    assert news["models"] == {}
    assert ("begun", 1) in [(e[3], e[2]) for e in news["events"]]
    fleet.feed("", "experiment", measured(1, start=later))  # the same again is no new run
    assert fleet.machine("/")["steps"][0]["level"] == -1


def test_a_prediction_of_another_run_is_not_drawn():
    """The number is the same, the start is not."""
    fleet = Fleet()
    fleet.feed("", "prediction", predicted(measured(1, start=5.0), 9.0))
    fleet.feed("", "experiment", measured(1))
    assert "predicted" not in rows_of(fleet.experiment("/", 1))
    short = measured(1, length=LENGTH // 2)
    stranger = Prediction(1, measured(1).start, short.period, 0, short.speed)
    fleet.feed("", "prediction", stranger)
    assert "predicted" not in rows_of(fleet.experiment("/", 1))


def test_there_is_no_such_thing():
    """A machine, an experiment, samples that nobody measured."""
    fleet = Fleet()
    assert fleet.machine("/none") is None
    assert fleet.experiment("/none", 1) is None
    fleet.feed("", "signal", Signal(1, Level.NEGATIVE, "threshold", 0, float("inf")))
    assert fleet.experiment("/", 1) is None
    assert fleet.machine("/")["steps"][0]["error"] is None


@given(st.lists(st.tuples(st.integers(1, 12), st.sampled_from(["a", "b"])), max_size=40))
def test_what_was_told_bit_by_bit_is_the_whole(fed):
    """A browser that merges what has changed knows what a new one is told."""
    fleet, held, since = Fleet(clock=lambda: 0.0, world=lambda: 0.0), {}, 0
    for i, (number, namespace) in enumerate(fed):
        feed(fleet, namespace, number, start=1e9 + i)
        news = fleet.machine("/a", since)
        if news is None:
            continue
        since = news["count"]
        held = {} if news["whole"] else held
        held |= {t["number"]: t for t in news["steps"]}
        held = {n: held[n] for n in news["numbers"]}
        assert list(held.values()) == sorted(
            fleet.machine("/a")["steps"], key=lambda t: t["number"]
        )
    json.dumps(fleet.overview(), allow_nan=False)


def test_streamed_samples_are_shown_as_they_come():
    """The last 20 s, thinned, newest last; once; a clock that went back begins anew."""
    fleet = Fleet()
    feed(fleet, "/a", 1, 0.5)
    assert "stream" not in fleet.machine("/a")
    for k in range(3000):
        fleet.sample("/a", 100.0 + k / 100, float(k))
    told = fleet.machine("/a")
    moments = [t for t, _ in told["stream"]]
    assert moments[-1] == 0
    assert -20 <= moments[0] < -19
    assert told["stream"][-1][1] == 2999
    assert 200 < len(moments) <= 300
    assert "stream" not in fleet.machine("/a", told["count"])
    fleet.sample("/a", 1.0, 5.0)
    fleet.sample("/a", math.nan, 5.0)
    assert fleet.machine("/a")["stream"] == [(0.0, 5.0)]
    json.dumps(fleet.machine("/a"), allow_nan=False)


# ---- a recording played back


def played(source: Playback) -> Fleet:
    fleet = Fleet(source.live)
    source.run(fleet, threading.Event(), begun=lambda: None)
    return fleet


def test_a_recording_shows_what_was_recorded(tmp_path):
    """All of its experiments, judged, with the machine's name; and that it has ended."""
    fleet = played(Playback(fake_run(tmp_path / "run"), rate="max"))
    told = fleet.machine("/")
    assert told["card"]["title"] == "rig"
    assert told["numbers"] == [1, 2, 3, 4, 5, 6]
    assert [t["error"] for t in told["steps"]] == [1.0 + 7 * n % 11 for n in range(1, 7)]
    assert told["diagnosis"]["sentence"] == "it is"
    assert "has ended" in fleet.overview()["state"]


def test_several_machines_of_a_recording_are_shown_or_one(tmp_path):
    """By namespace."""
    one = read_bag(fake_run(tmp_path / "one"))
    with BagWriter(tmp_path / "both", "rig") as bag:
        for raw in one.messages():
            for name in ("a", "b"):
                bag.write_raw(f"/{name}{raw.topic}", raw.kind, raw.data, raw.time_ns)
    assert set(played(Playback(tmp_path / "both", rate="max")).machines) == {"a", "b"}
    assert set(played(Playback(tmp_path / "both", "b", "max")).machines) == {"b"}
    with pytest.raises(RecordingError, match="a machine under /c"):
        Playback(tmp_path / "both", "c")


def test_what_cannot_be_read_is_counted_and_the_rest_shown(tmp_path):
    """As the nodes do it."""
    one = read_bag(fake_run(tmp_path / "one"))
    with BagWriter(tmp_path / "odd", "rig") as bag:
        for i, raw in enumerate(one.messages()):
            data = raw.data[:30] if i == 1 else raw.data
            bag.write_raw(raw.topic, raw.kind, data, raw.time_ns)
    told = played(Playback(tmp_path / "odd", rate="max")).machine("/")
    assert told["unreadable"] == 1
    assert "/experiment" in told["last_unreadable"]
    assert 6 in told["numbers"]


def test_a_recording_is_played_at_its_pace_and_stops_at_once(tmp_path):
    """The first experiment at once, the next when a machine would have finished it."""
    source = Playback(fake_run(tmp_path / "run"), rate="0.01")  # 60 s an experiment
    fleet, stop, shown = Fleet(False), threading.Event(), threading.Event()
    fleet.on_change = lambda: 1 in getattr(fleet.machines.get(""), "steps", {}) and shown.set()
    thread = threading.Thread(target=source.run, args=(fleet, stop, lambda: None))
    thread.start()
    assert shown.wait(20)
    stop.set()
    thread.join(20)
    assert not thread.is_alive()
    assert fleet.machine("/")["numbers"] in ([1], [1, 2])


def eventually(holds) -> None:
    """Within 20 s."""
    end = time.monotonic() + 20
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_recording_is_paused_set_forward_and_back_also_at_its_end(tmp_path):
    """Set to an experiment, it has just ended, with its signal; pausing holds it there."""
    source = Playback(fake_run(tmp_path / "run"), rate="0.01")  # 60 s an experiment
    source.stays = True
    fleet, stop = Fleet(False), threading.Event()
    thread = threading.Thread(target=source.run, args=(fleet, stop, lambda: None))
    thread.start()

    def judged() -> list[int]:
        machine = fleet.machine("/")
        return [s["number"] for s in machine["steps"] if s["error"] is not None] if machine else []

    try:
        eventually(lambda: fleet.machine("/") and fleet.machine("/")["numbers"] == [1])
        assert judged() == []  # it goes on still
        source.clock.pause(True)
        assert source.clock.total == 6
        for target, expected in ((4, 4), (2, 2), (99, 6), (3, 3)):
            source.clock.seek(target)
            eventually(lambda wanted=expected: judged() == list(range(1, wanted + 1)))
            assert fleet.overview()["playback"]["paused"]
            last = target == 99  # a page offers to play it again there
            eventually(lambda wanted=last: fleet.overview()["playback"]["ended"] == wanted)
        time.sleep(0.3)
        assert judged() == [1, 2, 3]
    finally:
        stop.set()
        thread.join(20)
    assert not thread.is_alive()


def test_the_time_of_a_recording_is_held_and_goes_on():
    """At its rate, and not while it is paused."""
    now = [100.0]
    clock, stop = PlaybackClock(10.0, 3, lambda: now[0]), threading.Event()
    assert clock.reach(5.0, 1, stop)
    clock.begin(5.0)
    now[0] += 2
    assert clock.state()["elapsed"] == 20.0
    clock.pause(True)
    now[0] += 50
    assert clock.state()["elapsed"] == 20.0
    clock.pause(False)
    now[0] += 1
    assert clock.state() == {
        "paused": False,
        "ended": False,
        "rate": 10.0,
        "position": 1,
        "total": 3,
        "elapsed": 30.0,
    }


def test_a_rate_that_is_none_is_refused(tmp_path):
    """By the one rule for rates."""
    with pytest.raises(OptionError, match="max or a number above 0"):
        Playback(fake_run(tmp_path / "run"), rate="fast")
