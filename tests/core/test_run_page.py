"""The page of a run: complete, self-contained, small, safe, and true to its recording."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from fake_run import PERIOD, fake_run
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from page_elements import Elements, needs_nothing_else
from unpacked import unpack

from ldt_core.base.errors import RecordingError
from ldt_core.base.experiment import Experiment, Level, Prediction, Signal
from ldt_core.base.model_state import STATES
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import BagWriter
from ldt_core.views.packed_samples import FEWEST_SAMPLES, LEVELS, ROOM, extremes, pack, room
from ldt_core.views.report.report_page import page, read_run
from ldt_core.views.report.report_sections import remarks
from ldt_core.views.step_view import statistic

SAMPLE = Path(__file__).resolve().parents[2] / "bags" / "rotor_drift"
LARGEST = 5_000_000  # bytes of the page of 200 experiments of 2000 samples
HOSTILE = "</script><img src=x onerror=alert(1)>\"' {{ 7*7 }} <!-- \u2028"
REAL = st.floats(-1e6, 1e6, allow_subnormal=False)


def data_of(text: str) -> dict:
    return json.loads(next(t for a, t in Elements(text).scripts if a.get("id") == "data"))


@pytest.fixture(scope="module")
def sample() -> str:
    return page(read_run(SAMPLE))


@pytest.fixture(scope="module")
def hostile(tmp_path_factory) -> str:
    folder = tmp_path_factory.mktemp("hostile")
    return page(read_run(fake_run(folder / "run", words=HOSTILE)))


@pytest.mark.slow
def test_the_page_needs_nothing_else(sample):
    """No address to load from, every element closed, each identifier once."""
    tags = needs_nothing_else(sample).tags
    links = {a["href"] for t, a in tags if t == "a" and "experiment-" not in a["href"]}
    assert links == {f"#{a['id']}" for t, a in tags if t == "section"}


def test_no_script_runs_but_ours(sample, hostile):
    """The policy names each script by its hash; what is in the data runs not."""
    for text in (sample, hostile):
        policy = next(a["content"] for t, a in Elements(text).tags if "http-equiv" in a)
        assert "default-src 'none'" in policy
        allowed = re.search(r"script-src ([^;]*)", policy)[1]
        hashes = [
            base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
            for attributes, script in Elements(text).scripts
            if attributes.get("type") != "application/json"
        ]
        assert allowed.split() == [f"'sha256-{h}'" for h in hashes]


def test_texts_of_a_recording_stay_texts(hostile):
    """Names, reasons and sentences are shown as they are, and are never markup."""
    elements = Elements(hostile)
    assert not elements.open
    assert "img" not in {t for t, _ in elements.tags}
    assert len(elements.scripts) == 3
    assert f"machine rig{HOSTILE}" in unescape(hostile)
    data = data_of(hostile)
    assert data["reason"] == [f"since{HOSTILE}"] * 6
    assert data["diagnoses"]["3"] == f"it is{HOSTILE}"
    assert data["models"]["3"] == {"kind": f"kind{HOSTILE}", "learned": [3]}


def test_the_worst_comes_first(tmp_path):
    """In the chooser's order, in the table and in the answer."""
    run = read_run(fake_run(tmp_path / "run"))
    text = page(run)
    data = data_of(text)
    worst = sorted(range(1, 7), key=lambda n: -(1 + 7 * n % 11))
    assert [data["number"][i] for i in data["worst"]] == worst
    assert [int(n) for n in re.findall(r"#experiment-(\d+)", text)] == worst
    assert (
        f"The worst was experiment {worst[0]}, with an error of {max(data['error']):.1f} rad/s"
        in text
    )
    assert "The last diagnosis, at experiment 6, names unbalance." in text
    assert "diagnosis, at" not in page(read_run(SAMPLE))


def test_the_figures_are_the_recording_s(sample):
    """Error, original error, signal, action and models of the sample recording."""
    bag, data = read_bag(SAMPLE), data_of(sample)
    signals = list(bag.records("signal"))
    assert data["number"] == list(range(1, 41))
    np.testing.assert_allclose(data["error"], [s.max_error for s in signals], rtol=1e-5)
    assert data["level"] == [int(s.level) for s in signals]
    assert data["action"] == [str(a.action) for a in bag.records("adaptation")]
    assert len(data["models"]) == 23
    assert data["statistic"]["label"] == "largest error in an experiment [rad/s]"
    assert set(data["statistic"]["drift"]) == {3.0}
    assert "the error is 88 % of the original model&#39;s (8.86 of 10.1 rad/s)" in sample
    assert "There were 29 alarms, and 22 new models took over" in sample


def test_samples_of_the_page_are_the_recording_s():
    """Nothing is thinned in a small run, and a code's error is half a step."""
    run = read_run(SAMPLE)
    assert not run.thinned
    experiments = {e.number: e for e in run.bag.experiments()}
    for step in run.steps[::13]:
        rows, one = unpack(step.packed), experiments[step.number]
        np.testing.assert_allclose(rows["time"], one.time, atol=1e-9)
        sizes = {c.name: c.step for c in step.packed.channels}
        for name, row in (("voltage", one.voltage), ("measured", one.speed)):
            assert np.abs(rows[name] - row).max() <= 0.51 * sizes[name]


@given(arrays(np.float64, st.tuples(st.integers(1, 5), st.integers(1, 400)), elements=REAL),
       st.integers(12, 120))  # fmt: skip
def test_thinning_keeps_every_row_s_extremes_and_both_ends(rows, most):
    """Whatever the samples, in order and within the room."""
    at = extremes(rows, most)
    assert at.size <= most
    assert (np.diff(at) > 0).all()
    assert at[0] == 0
    assert at[-1] == rows.shape[1] - 1
    np.testing.assert_array_equal(rows[:, at].max(axis=1), rows.max(axis=1))
    np.testing.assert_array_equal(rows[:, at].min(axis=1), rows.min(axis=1))
    if rows.shape[1] <= most:
        assert at.size == rows.shape[1]


@given(st.integers(2, 300), st.integers(14, 60), st.data())
def test_a_spike_of_one_sample_is_seen(length, most, data):
    """Of the error as of each curve: where it is, and how high."""
    at = data.draw(st.integers(0, length - 1))
    flat = np.full(length, 5.0)
    spiked = flat.copy()
    spiked[at] = 25.0
    one = Experiment(1, 0.0, PERIOD, flat, spiked)
    rows = unpack(pack(one, Prediction(1, 0.0, PERIOD, 0, flat), None, most))
    peak = int(np.argmax(rows["measured"] - rows["predicted"]))
    assert rows["measured"][peak] == pytest.approx(25.0)
    assert rows["time"][peak] == pytest.approx(at * PERIOD)


@given(arrays(np.float64, st.integers(1, 50), elements=st.floats(-1e300, 1e300)))
def test_codes_reach_both_ends_whatever_the_range(row):
    """A constant row, a tiny range and one beyond what a float's difference can hold."""
    one = Experiment(1, 0.0, PERIOD, row, np.zeros(row.size))
    packed = pack(one, Prediction(1, 0.0, PERIOD, 0, np.zeros(row.size)), None, 100)
    got = unpack(packed)["voltage"]
    half = 0.51 * (row.max() / LEVELS - row.min() / LEVELS)
    tiny = 1e-12 * np.abs(row).max() + 1e-300
    assert np.abs(got / 2 - row / 2).max() <= half + tiny


@pytest.mark.slow
@pytest.mark.parametrize("deviation", [True, False])
def test_two_hundred_long_experiments_stay_below_five_megabytes(deviation, tmp_path):
    """200 of 2000 samples, with what they hold in random numbers, which is the worst case."""
    path = fake_run(tmp_path / "run", range(1, 201), 2000, deviation=deviation)
    run = read_run(path)
    text = page(run)
    assert LARGEST / 2 < len(text.encode()) < LARGEST
    assert run.thinned == 200
    assert f"thinned to at most {max(s.packed.kept for s in run.steps)}" in text
    for step in run.steps:
        rows = unpack(step.packed)
        error = np.abs(rows["measured"] - rows["predicted"]).max()
        assert error == pytest.approx(step.signal.max_error, abs=1e-3)


@pytest.mark.parametrize("state", STATES.values(), ids=STATES)
def test_the_state_is_the_lamp(state, tmp_path):
    """In words and colour, with the error over the noise; the detector's word stands beside."""
    adequacy = 1.1 if state.name == "holds" else 14.2
    text = page(read_run(fake_run(tmp_path / "run", state=state.name, adequacy=adequacy)))
    lamp = re.search(r'<div class="answer (\w+)">.*?</div>', text, re.DOTALL)
    assert lamp[1] == state.tone
    assert f"</svg>{state.words}</span>" in lamp[0]
    words = "1.1 times the noise" if state.name == "holds" else "14 times the noise"
    assert f"since experiment 1; error {words}; detector: alarm; experiment 6, the last" in lamp[0]
    data = data_of(text)
    assert data["state"] == [state.name] * 6
    assert data["noise"] == [adequacy] * 6
    assert data["states"][state.name] == [state.words, state.tone]
    assert "judged" not in lamp[0]
    assert "The model held in" not in lamp[0]  # the strip below counts the states


@pytest.mark.parametrize(("state", "adequacy"), [("", None), ("", 1.0), ("holds", 10.0)])
def test_what_nobody_judged_is_grey(state, adequacy, tmp_path):
    """An old recording, and one that says of ten times the noise that the model holds."""
    text = page(read_run(fake_run(tmp_path / "run", [1, 2], state=state, adequacy=adequacy)))
    assert '<div class="answer open">' in text
    assert "</svg>not judged</span>" in text
    assert "Whether the model held was not judged." in text
    assert "answer good" not in text
    assert 'class="state good"' not in text
    assert data_of(text)["state"] == ["", ""]


def test_evidence_beyond_measure_is_no_statistic_to_draw():
    """The detector adequacy shows the error over the noise, not 1e260 of evidence and its limit."""
    figures = {"misfit": 1e260, "drift_limit": 1000.0}
    own = Signal(1, Level.POSITIVE, "adequacy", 0, 2.0, figures, "changed", 14.0)
    assert statistic([own]).label == "error over the noise"
    assert (statistic([own]).values, statistic([own]).drift) == ([14.0], [None])


def test_evidence_beyond_measure_is_told_as_such(tmp_path):
    """In the settings' last statistics no number of a hundred digits is told."""
    run = read_run(fake_run(tmp_path / "run", [1, 2]))
    run.signals[-1] = replace(run.signals[-1], statistics={"unexplained": 1.94e130, "misfit": 2.0})
    assert "unexplained over 1e+09, misfit 2" in page(run)


def test_without_room_the_worst_keep_their_samples(tmp_path, monkeypatch):
    """And the page says that the others have none."""
    assert room(1, 6)[0] > room(200, 6)[0] > room(10**6, 6)[0] >= FEWEST_SAMPLES
    path = fake_run(tmp_path / "run")
    monkeypatch.setattr("ldt_core.views.packed_samples.ROOM", ROOM * 3 // room(10**6, 6)[1])
    run = read_run(path)
    drawn = [run.steps[i].packed is not None for i in run.worst_first]
    assert drawn == [True, True, True, False, False, False]
    assert "no room for the samples of 3 experiments with the least error" in page(run)


def test_what_is_odd_about_the_recording_is_said(tmp_path):
    """Numbers that are missing, experiments without a prediction, pauses."""
    path = fake_run(tmp_path / "run", [1, 2, 6, 7], unpredicted=[2])
    run = read_run(path)
    found = " | ".join(f.message for f in remarks(run))
    assert "numbers 3 to 5 missing" in found
    assert "number 2 without prediction, signal, adaptation" in found
    assert "1 longer than an experiment, 1.8 s before number 6" in found
    assert "Mind the health of the recording: 3 remarks." in page(run)
    assert str(tmp_path) not in page(run)


def test_a_sound_recording_is_said_to_be_sound(tmp_path):
    """Not left open."""
    run = read_run(fake_run(tmp_path / "run"))
    assert remarks(run) == []
    assert "Mind the health" not in page(run)
    assert "No experiment is missing, repeated, late or unused" in page(run)


def test_long_tables_are_folded_so_that_what_follows_is_found(tmp_path):
    """Of 66 experiments 22 were positive; of 6, two, whose rows stand open."""
    folded = "<details><summary>What was learned at each alarm (22 rows)</summary>"
    assert folded in page(read_run(fake_run(tmp_path / "long", range(1, 67))))
    assert "<summary>The adaptor" not in page(read_run(fake_run(tmp_path / "short")))


def test_a_card_names_what_says_nothing_by_itself(sample):
    """On a phone, where the heads of the columns are not seen."""
    assert '<td data-name="learned from experiments">nothing</td>' in sample
    assert '<td data-name="used in experiments">' in sample


def test_what_the_nodes_rejected_is_shown(tmp_path):
    """The last health of each node of this machine, escaped."""
    from ldt_core.recording.messages import standard

    make = standard()

    def status(name: str, values: dict[str, str]):
        pairs = [make.KeyValue(key=k, value=v) for k, v in values.items()]
        level = make.level(1)
        return make.DiagnosticStatus(
            level=level, name=name, message="2 messages rejected", hardware_id="rig", values=pairs
        )

    path = fake_run(tmp_path / "whole")
    copy = tmp_path / "graph"
    told = {"rejected experiment: ExperimentError": "2", "last rejection": f"why{HOSTILE}"}
    with BagWriter(copy, "rig") as bag:
        for raw in read_bag(path).messages():
            bag.write_raw(raw.topic, raw.kind, raw.data, raw.time_ns)
        for statuses in ([status("twin", told)], [status("other/twin", {})]):
            stamp = make.Time(sec=1, nanosec=0)
            header = make.Header(stamp=stamp, frame_id="")
            bag.write("/diagnostics", make.DiagnosticArray(header=header, status=statuses), 1.0)
    run = read_run(copy)
    assert list(run.health.nodes) == ["twin"]
    text = page(run)
    assert '<td data-name="rejected">2 × experiment: ExperimentError' in text
    assert f"why{HOSTILE}" in unescape(text)
    assert "<img" not in text


def test_a_detector_that_nobody_knows_shows_its_first_figure():
    """Or the maximum error where it tells no figure; what is not finite is a gap."""
    own = Signal(1, Level.WARNING, "mine.py:Mine", 0, 2.0, {"drift_limit": 3.0, "my_rate": 0.5})
    assert statistic([own]).label == "my rate"
    assert statistic([own]).values == [0.5]
    bare = Signal(1, Level.WARNING, "mine.py:Mine", 0, 2.0, {"drift_limit": float("inf")})
    assert statistic([bare]).values == [2.0]
    assert statistic([bare]).drift == [None]


def test_experiments_without_a_twin_are_refused(tmp_path):
    """In one sentence that says what makes a run of them."""
    with BagWriter(tmp_path / "plain", "rig") as bag:
        one = Experiment(1, 0.0, PERIOD, np.ones(5), np.ones(5))
        bag.write("experiment", one, one.end)
    with pytest.raises(RecordingError, match=r"ldt replay makes one.*no topic prediction"):
        read_run(tmp_path / "plain")
    fake_run(tmp_path / "none", [1, 2], unpredicted=[1, 2])
    with pytest.raises(RecordingError, match="no topic prediction and no topic signal"):
        read_run(tmp_path / "none")
