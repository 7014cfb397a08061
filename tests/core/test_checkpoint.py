"""Claims about checkpoints: a restart reads the end of a recording, and nothing comes out other."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies

from ldt_core.base.digest import json_digest
from ldt_core.base.errors import LdtError, RecordingError
from ldt_core.base.experiment import (
    Action,
    Adaptation,
    DiagnosisRecord,
    Experiment,
    Level,
    Prediction,
)
from ldt_core.base.settings import resolve
from ldt_core.detectors.lddm import LDDM
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import Bag
from ldt_core.recording.writer import BagWriter
from ldt_core.restart.checkpoint import Lookup
from ldt_core.restart.recorded_run import END, RecordedRun
from ldt_core.restart.stage_restart import StageRestart, TwinRestart
from ldt_core.twin.adaptor import ROLLED_BACK
from ldt_core.twin.detector_stage import DetectorStage
from ldt_core.twin.loop import Twin
from ldt_core.twin.stage import WINDOW, RecordedStep

MACHINE = load_machine("rotor")
COUNT, EVERY, LENGTH = 640, 20, 8
GIVEN = {
    **resolve({}),
    **{"model": "physics", "detector": "lddm", "memory_limit": 12, "history": 3},
    **{"diagnose": True, "advice": True, "advice_every": 7, "checkpoint_every": EVERY},
}
KILLS = (330, 459, 640)  # between two checkpoints, right before one, and right at one
TOPICS = ("experiment", "prediction", "original_prediction", "signal", "diagnosis", "model",
          "adaptation")  # fmt: skip


def made_up():
    """Steps with a real detector's answers, of a machine that is off for a while now and then.

    At a positive a model is adopted, and a diagnosis made, which says no more than its number.
    """
    twin = Twin.from_settings(MACHINE, GIVEN)
    untrained = twin.model.record()
    version, steps = 0, []
    for number in range(1, COUNT + 1):
        random = np.random.default_rng(number)
        voltage, speed = random.uniform(0, 10, LENGTH), random.uniform(0, 100, LENGTH)
        one = Experiment(number, 1e9 + number, MACHINE.sample_period, voltage, speed)
        off = random.normal(0, 1.5 if number % 90 > 70 else 0.5, LENGTH)
        said = Prediction(number, one.start, one.period, version, speed - off)
        signal = twin.detector.step(one, said)
        model, verdict, action = None, None, Action.KEPT
        if signal.level is Level.POSITIVE:
            values = {"verdict.kind": "effect"}
            verdict = DiagnosisRecord(number, version, "made up", (), values)
            version, action = version + 1, Action.ADAPTED
            model = replace(untrained, version=version, trained_on=(number,))
        elif signal.level is Level.WARNING:
            action = Action.STORED
        told = Adaptation(number, action, version, "made up", {})
        steps.append(RecordedStep(one, said, signal, told, model, verdict))
    levels = Counter(step.signal.level for step in steps)
    assert min(levels[level] for level in Level) > 10, levels
    return steps


STEPS = made_up()


def write(writer, step):
    """Record a step, in a chunk of its own, as of a machine that takes its time."""
    records = {**vars(step), "original_prediction": step.prediction}
    for topic in TOPICS:
        if records[topic] is not None:
            writer.write(topic, records[topic], step.experiment.end)
    writer.flush()


def known(twin):
    """All that a twin knows, in JSON."""
    found = {name: stage.state() for name, stage in twin.stages.items()}
    found["detector"] = twin.detector.detector.state()
    starts = list(twin.predictor.starts.items())
    return json.dumps([found, twin.predictor.last, starts, twin.model.version])


def recorded(folder):
    return RecordedRun(folder, "", MACHINE)


class Killed:
    """A run that was killed after a step.

    Args:
        folder: its recording and its checkpoints.
        was: what its twin knew.
    """

    def __init__(self, folder, was):
        self.folder, self.was = folder, was

    def files(self, stage="*"):
        """Its checkpoints, the newest first."""
        found = self.folder.glob(f"{stage}.*.checkpoint")
        return sorted(found, key=lambda f: -json.loads(f.read_text())["experiment"])

    def taken_up(self, **other):
        """What a twin knows that goes on there, how many steps it recalled, and what was told."""
        twin, told, steps = Twin.from_settings(MACHINE, {**GIVEN, **other}), [], []
        recall = twin.adaptor.recall
        twin.adaptor.recall = lambda step: (steps.append(step), recall(step))
        TwinRestart(twin, recorded(self.folder), told.append).resume()
        return known(twin), len(steps), told


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """The run, killed after each of the steps in `KILLS`, so that its last file has no end."""
    place, found = tmp_path_factory.mktemp("checkpoints"), {}
    twin = Twin.from_settings(MACHINE, GIVEN)
    with BagWriter(place / "run", "rotor", split_size=0.2) as writer:
        writer.write("model", twin.model.record(), 1e9)
        restart = TwinRestart(twin, recorded(place / "run"), pytest.fail)
        for step in STEPS:
            number = step.experiment.number
            write(writer, step)
            restart.recall(step)
            if number in KILLS:
                shutil.copytree(place / "run", place / str(number))
                found[number] = Killed(place / str(number), known(twin))
    assert len(list((place / str(COUNT)).glob("*.mcap"))) > 2
    return found


@pytest.fixture(scope="module")
def lookup(runs):
    """Finds what the last run's checkpoints name, without having read its last steps."""
    return Lookup(recorded(runs[COUNT].folder).bag(listed=True), MACHINE, GIVEN, ())


@pytest.fixture
def run(runs, tmp_path):
    """The one killed at the end, for a test that changes it."""
    shutil.copytree(runs[COUNT].folder, tmp_path / "run")
    return Killed(tmp_path / "run", runs[COUNT].was)


@pytest.mark.slow
@pytest.mark.parametrize("end", KILLS)
def test_a_twin_goes_on_from_a_checkpoint_as_from_the_whole_recording(end, runs):
    """What it knows is the same to the last bit; it recalls what came since, and no more."""
    was, recalled, told = runs[end].taken_up()
    assert (was, recalled, told) == (runs[end].was, end % EVERY, [])


@pytest.mark.slow
def test_a_recording_that_was_taken_up_again_is_as_good(run):
    """Its recorder has mended what the killed one left, and has begun a new file."""
    BagWriter(run.folder, "rotor", resume=True, once=True).close()
    assert run.taken_up() == (run.was, COUNT % EVERY, [])


def changed(file, **change):
    """A checkpoint that says something else, and is whole."""
    content = {**json.loads(file.read_text()), **change}
    del content["digest"]
    file.write_text(json.dumps({**content, "digest": json_digest(content)}))


def flipped(file):
    text = file.read_text()
    file.write_text(text.replace(f'"experiment": {COUNT}', f'"experiment": {COUNT - 1}'))


def returned(folder, told):
    """The step to which the detector goes back by its checkpoints."""
    return detector_restart(folder, told).return_to_checkpoint()


def detector_restart(folder, told):
    stage = Twin.from_settings(MACHINE, GIVEN).detector
    return StageRestart(stage, "detector", recorded(folder), GIVEN, told.append)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (flipped, "damaged"),
        (lambda f: f.write_bytes(f.read_bytes()[:-9]), "ignored"),
        (lambda f: f.write_bytes(b""), "ignored"),
        (lambda f: f.write_bytes(b"[" * 100_000), "ignored"),
        (lambda f: f.write_bytes(b" " * 4_000_001), "at most"),
        (lambda f: changed(f, key="0"), "another run"),
        (lambda f: changed(f, format="ldt-checkpoint-0"), "another version"),
        (lambda f: changed(f, experiment=2**60), "number"),
        (lambda f: changed(f, experiment=-3), "number"),
        (lambda f: changed(f, start="soon"), "start"),
        (lambda f: changed(f, state=[1]), "state"),
    ],
)
def test_a_file_that_is_no_checkpoint_of_the_run_is_told_and_left_out(spoil, words, run):
    """The one before it is still there."""
    told = []
    files = detector_restart(run.folder, told).files
    newest = max(files.paths, key=lambda f: json.loads(f.read_text())["experiment"])
    assert [c.experiment for c in files.read()] == [COUNT, COUNT - EVERY]
    spoil(newest)
    assert [c.experiment for c in files.read()] == [COUNT - EVERY]
    assert len(told) == 1
    assert words in told[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"experiment": COUNT + 50}, "complete"),
        ({"start": 1.5e9}, "640 at 1500000000.0"),
        ({"speed": "0"}, "another"),  # as of a run with another seed that began at that time
        ({"state": {}}, "keys"),
    ],
)
def test_a_step_that_the_recording_does_not_have_does_not_count(change, words, run):
    """The checkpoint before it does, and none where that is no better."""
    told = []
    files = {json.loads(f.read_text())["experiment"]: f for f in run.files("detector")}
    changed(files[COUNT], **change)
    assert returned(run.folder, told) == COUNT - EVERY
    assert len(told) == 1
    assert words in told[0]
    changed(files[COUNT - EVERY], **change)
    assert returned(run.folder, told) == 0


@pytest.mark.slow
def test_without_a_checkpoint_that_counts_the_recording_alone_decides(runs, tmp_path):
    """All are newer than what was recorded: its recorder could not write, and the others could."""
    shutil.copytree(runs[330].folder, tmp_path / "run")
    for file in runs[640].files():
        shutil.copy(file, tmp_path / "run")
    killed = Killed(tmp_path / "run", runs[330].was)
    was, recalled, told = killed.taken_up()
    assert (was, recalled) == (killed.was, 330)
    assert len(told) == len(killed.files())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stage", "change"),
    [
        ("detector", {"errors": 1e308 * 10}),
        ("detector", {"signal": 7}),
        ("adaptor", {"version": 10**9}),
        ("adaptor", {"version": -1}),
        ("adaptor", {"earlier": [0] * 20}),
        ("adaptor", {"named": 10**9}),
        ("adaptor", {"memory": {"dropped": 0, "kept": [[1, 2.0]], "recent": []}}),
        ("adaptor", {"memory": {"dropped": -1, "kept": [], "recent": []}}),
        ("adaptor", {"memory": {"dropped": 0, "recent": [], "kept": [
            [n, 1e9 + n] for n in range(COUNT - 30, COUNT)]}}),
        ("diagnoser", {"since": "x"}),
        ("diagnoser", {"recent": [[COUNT, 1e9 + COUNT, 5]]}),
        ("advisor", {"recent": {"a": 1}}),
        ("advisor", {"last": 0.5}),
    ],
)  # fmt: skip
def test_nothing_is_taken_of_a_state_that_cannot_be(stage, change, runs, lookup):
    """Whole, under the run's key, and made up: the stage is left as it was."""
    own = Twin.from_settings(MACHINE, GIVEN).stages[stage]
    before = own.state()
    newest = runs[COUNT].files(stage)[0]
    state = json.loads(newest.read_text())["state"]
    with pytest.raises((LdtError, ValueError, TypeError, KeyError, AttributeError)):
        own.return_to({**state, **change}, lookup)
    assert own.state() == before
    own.return_to(state, lookup)
    assert own.state() == state


def test_a_rollback_behind_a_checkpoint_counts(run):
    """The step of the newest checkpoint ended otherwise than that knows."""
    told = []
    model = replace(next(s.model for s in STEPS if s.model), version=900)
    with BagWriter(run.folder, "rotor", resume=True) as writer:
        writer.write("model", model, 2e9)
        by_hand = Adaptation(COUNT, Action.ADAPTED, 900, "by hand", {ROLLED_BACK: 1})
        writer.write("adaptation", by_hand, 2e9)
    assert returned(run.folder, told) == COUNT - EVERY
    assert "the same step" in told[0]


def test_checkpoints_take_turns_and_stop_with_the_run(run):
    """Two files a stage, whatever the length; the older one is replaced, also after a restart."""
    names = {f.name for f in run.files()}
    assert names == {
        f"{s}.{i}.checkpoint" for s in Twin.from_settings(MACHINE, GIVEN).stages for i in (0, 1)
    }
    before = {f.name: json.loads(f.read_text())["experiment"] for f in run.files()}
    twin = Twin.from_settings(MACHINE, GIVEN)
    restart = TwinRestart(twin, recorded(run.folder), pytest.fail)
    restart.resume()
    for number in range(COUNT + 1, COUNT + EVERY + 1):
        restart.passed(replace(STEPS[0].experiment, number=number))
    after = {f.name: json.loads(f.read_text())["experiment"] for f in run.files()}
    for name, number in before.items():
        assert after[name] == (COUNT + EVERY if number == COUNT - EVERY else COUNT)


class Own(LDDM):
    """A user's own, of which nobody knows whether its state is all."""


def test_a_detector_that_does_not_say_its_state_is_told_all_of_the_recording(runs):
    """It has no checkpoint; the other stages go on from theirs, and nothing comes out other."""
    twin = Twin.from_settings(MACHINE, GIVEN, DetectorStage("lddm", Own()))
    assert (twin.detector.state(), twin.adaptor.state() is None) == (None, False)
    (runs[640].folder / "own").mkdir()
    restart = TwinRestart(twin, recorded(runs[640].folder / "own"), pytest.fail)
    for step in STEPS[: 2 * EVERY]:
        restart.passed(step.experiment)
    assert not list((runs[640].folder / "own").glob("detector*"))
    assert list((runs[640].folder / "own").glob("adaptor*"))


def test_where_they_cannot_be_kept_it_is_told_once(tmp_path):
    """A full disk must not end the twin."""
    told = []
    restart = detector_restart(tmp_path, told)
    for slot in restart.files.paths:
        slot.mkdir()
    for step in STEPS[: 3 * EVERY]:
        restart.passed(step.experiment)
    assert len(told) == 1
    assert "no checkpoints of the detector are kept" in told[0]


def numbers(steps):
    return [step.experiment.number for step in steps]


@pytest.mark.slow
@settings(max_examples=5, deadline=None)
@given(around=strategies.integers(1, COUNT + 300))
def test_the_steps_around_an_experiment_are_those_of_the_whole_recording(around, runs):
    """From enough before it on, up to the end."""
    found = numbers(recorded(runs[640].folder).steps(around))
    assert found == list(range(found[0], COUNT + 1))
    assert found[0] <= max(around - WINDOW, 1)


def test_the_end_is_read_in_a_time_that_does_not_grow(runs, monkeypatch):
    """By the messages that are decoded; those of the whole recording are more the longer it is."""
    counted = []
    decoded = Bag.decoded
    monkeypatch.setattr(Bag, "decoded", lambda *a: (counted.append(1), decoded(*a))[1])
    costs = {}
    for end, around in ((330, END), (640, END), (640, 0)):
        counted.clear()
        assert numbers(recorded(runs[end].folder).steps(around))[-1] == end
        costs[end, around] = len(counted)
    # A step is four messages, and the places in a recording are found in steps of NEAR bytes.
    assert costs[640, END] - costs[330, END] < 4 * WINDOW
    assert costs[640, 0] - costs[640, END] > 12 * WINDOW


@pytest.mark.slow
def test_disorder_gaps_and_strangers_do_not_mislead_it(tmp_path):
    """Blocks of one topic after the other, numbers far apart, an old and a future number."""
    with BagWriter(tmp_path / "run", "rotor") as writer:
        for begin in range(0, COUNT, 20):
            for topic in reversed(TOPICS):
                for step in STEPS[begin : begin + 20]:
                    records = {**vars(step), "original_prediction": step.prediction}
                    record = records[topic]
                    if record is not None and topic != "model":
                        record = spread(record)
                    if record is not None:
                        writer.write(topic, record, step.experiment.end)
                writer.flush()
            for number in (3, 10**7):
                writer.write("experiment", replace(STEPS[0].experiment, number=number), 2e9)
    whole = numbers(recorded(tmp_path / "run").steps())
    assert len(whole) == COUNT
    for around in (whole[400], whole[639], END):
        found = numbers(recorded(tmp_path / "run").steps(around))
        assert found == whole[-len(found) :]
        assert sum(number < around for number in found) >= WINDOW


def spread(record):
    """With a gap in the numbers behind every second."""
    if "experiment" in vars(record):
        return replace(record, experiment=3 * record.experiment // 2)
    return replace(record, number=3 * record.number // 2)


def test_what_was_kept_long_ago_is_found_again(lookup):
    """Experiments, models and diagnoses from anywhere, each the one that was recorded."""
    for step in STEPS[::97]:
        number = step.experiment.number
        found = lookup.experiment(number, step.experiment.start)
        assert np.array_equal(found.speed, step.experiment.speed)
    named = [step for step in STEPS if step.model]
    for step in named[::9]:
        assert lookup.model(step.model.version).record() == step.model
        assert lookup.diagnosis(step.experiment.number) == step.diagnosis
    for missing in (
        lambda: lookup.experiment(5, 7.0),
        lambda: lookup.experiment(10**6, 1e9),
        lambda: lookup.model(10**6),
        lambda: lookup.diagnosis(1),
    ):
        with pytest.raises(RecordingError):
            missing()


def test_an_adaptor_that_diagnoses_knows_what_was_named_last(lookup):
    """The record is read again; its diagnoser knows that it explains the machine."""
    given = {
        **GIVEN,
        "model": "diagnosed",
        "cause": "auto",
        "diagnose": False,
        "diagnosis_after": 0,
    }
    one, other = (Twin.from_settings(MACHINE, given).adaptor for _ in range(2))
    for step in STEPS:  # a positive may be the one in which the machine changed, which asks nothing
        one.diagnoser.recall(step)
        if one.diagnoser.state()["last"]:
            break
    one.named = step.diagnosis
    other.return_to(json.loads(json.dumps(one.state())), lookup)
    assert other.named == step.diagnosis
    known = one.diagnoser.state()
    assert other.diagnoser.state() == known
    assert known["last"]["error"] > 0
    assert known["recent"][-1][0] == step.number


@pytest.mark.slow
def test_damage_on_the_way_leaves_it_to_the_whole_recording(run):
    """Which is read behind the damage as ever."""
    for file in run.folder.glob("*.mcap"):
        data = bytearray(file.read_bytes())
        for at in range(3000, len(data), 20_000):
            data[at] ^= 255
        file.write_bytes(data)
    assert numbers(recorded(run.folder).steps(END)) == numbers(recorded(run.folder).steps())
