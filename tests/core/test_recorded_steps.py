"""Claims about going on from a recording: the state of the twin is what it was."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from ldt_core.base.errors import ModelError, RecordingError
from ldt_core.base.experiment import Action
from ldt_core.base.settings import resolve
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.recording.messages import standard
from ldt_core.recording.step_search import StepSearch
from ldt_core.recording.writer import BagWriter
from ldt_core.restart.checkpoint import Lookup
from ldt_core.restart.recorded_run import RecordedRun, complete_steps
from ldt_core.restart.stage_restart import TwinRestart
from ldt_core.runs.offline import run, write_step
from ldt_core.twin.loop import Twin
from ldt_core.twin.stage import WINDOW

SHORT = replace(load_machine("rotor"), duration=4.0)


def settings(**given):
    return resolve(
        {"experiments": 24, "seed": 3, "start_time": 1e9, "degradation": "ramp", **given}
    )


def experiments(given):
    plant = Plant.from_settings(SHORT, given)
    return [plant.experiment(n) for n in range(1, given["experiments"] + 1)]


def recorded(path, given, made):
    run(SHORT, given, made, path)
    return read_bag(path)


def recalled(twin, steps):
    """Let a twin take over recorded steps, as one that goes on from a recording does."""
    restart = TwinRestart(twin, RecordedRun("", "", SHORT), pytest.fail)
    for step in steps:
        restart.recall(step)


def same(one, other):
    """Whether two records say the same, to the last bit."""
    if type(one) is not type(other):
        return False
    if one is None or isinstance(one, bool):
        return one is other
    return all(
        np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b
        for a, b in zip(vars(one).values(), vars(other).values(), strict=True)
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "given",
    [
        # Where an order is given: choosing one is most of the work, and nothing that is recalled.
        {"model": "linear", "order": 1, "detector": "threshold", "experiments": 16},
        {
            "model": "linear",
            "order": 1,
            "detector": "threshold",
            "gate": "none",
            "data": "warning-set",
            "warning_threshold": 0.3,
        },
        {"model": "linear", "order": 1, "detector": "adequacy", "experiments": 16},
        {"model": "hybrid", "experiments": 12, "degradation": "abrupt", "inducing": 30},
        {"model": "diagnosed", "cause": "unbalance", "experiments": 12, "degradation": "abrupt"},
        {"model": "linear", "order": 1, "advice": True, "advice_every": 3, "degradation": "abrupt"},
    ],
    ids=lambda g: "-".join(str(v) for v in g.values()),
)
def test_a_twin_goes_on_from_any_step_as_if_nothing_had_happened(given, tmp_path):
    """Recalled to any step, it predicts, judges, learns and advises as the one that ran through."""
    given = settings(**given)
    made = experiments(given)
    steps = list(Twin.from_settings(SHORT, given).steps(made))
    assert any(s.adaptation.action is Action.ADAPTED for s in steps[:-2])  # there is a state
    told = list(complete_steps(recorded(tmp_path / "run", given, made), SHORT))
    assert [p.experiment.number for p in told] == [s.experiment.number for s in steps]
    for end in range(0, len(steps), 5):
        twin = Twin.from_settings(SHORT, given)
        recalled(twin, told[:end])
        # As far as one cycle of everything that follows: all of it costs the square of the run.
        for ran, step in zip(steps[end : end + 4], twin.steps(made[end:]), strict=False):
            for part in ("prediction", "signal", "adaptation", "model", "advice"):
                assert same(getattr(ran, part), getattr(step, part)), (end, part)


@pytest.mark.slow
def test_a_recording_in_the_disorder_of_a_restart_gives_the_same_steps(tmp_path):
    """Topics one after the other, and some messages twice, within what is sent again."""
    given = settings(model="linear", order=1, experiments=10)
    bag = recorded(tmp_path / "run", given, experiments(given))
    names = ("adaptation", "signal", "prediction", "experiment", "model")
    with BagWriter(tmp_path / "mixed", "rotor") as writer:
        for name in (*names, "experiment", "signal"):
            for record in bag.records(name):
                writer.write(name, record, 1e9)
    mixed = list(complete_steps(read_bag(tmp_path / "mixed"), SHORT))
    for one, other in zip(complete_steps(bag, SHORT), mixed, strict=True):
        assert all(
            same(a, b) for a, b in zip(vars(one).values(), vars(other).values(), strict=True)
        )


@pytest.mark.slow
def test_the_past_ends_with_the_last_complete_step(tmp_path):
    """A model or an adaptation that is missing at the end is made again; nothing is passed over."""
    given = settings(model="linear", order=1, gate="none")
    steps = list(Twin.from_settings(SHORT, given).steps(experiments(given)))
    learned = next(i for i, s in enumerate(steps) if s.model is not None)
    for missing in ("model", "adaptation", "signal"):
        path = tmp_path / missing
        with BagWriter(path, "rotor") as writer:
            for step in steps[:learned]:
                write_step(writer, step)
            last = steps[learned]
            for name in ("experiment", "prediction", "signal", "model", "adaptation"):
                if name != missing:
                    writer.write(name, getattr(last, name), last.experiment.end)
            write_step(writer, steps[learned + 1])
        numbers = [p.experiment.number for p in complete_steps(read_bag(path), SHORT)]
        assert numbers == list(range(1, learned + 1))


def test_experiments_that_the_recorder_missed_hold_up_nothing(tmp_path):
    """Who asks a node gets what it missed; a machine of the user's does not send again.

    A twin that goes on knows the steps behind the gap, and the model that was adopted in it. Its
    detector, which counts, cannot answer as the one that saw all; it is the same all the same.
    """
    given = settings(model="linear", order=1, gate="none", detector="window", window=5)
    made = experiments(given)
    steps = list(Twin.from_settings(SHORT, given).steps(made))
    learned = next(i for i, s in enumerate(steps) if s.model is not None)
    kept = next(i for i, s in enumerate(steps) if i > learned and s.model is None)
    for end in (kept, len(steps) - 1):
        with BagWriter(tmp_path / f"to_{end}", "rotor") as writer:
            for step in steps[: end + 1]:
                for name in ("experiment", "prediction", "signal", "model", "adaptation"):
                    record = getattr(step, name)
                    if record is not None and (name != "experiment" or step is not steps[learned]):
                        writer.write(name, record, step.experiment.end)
        told = list(complete_steps(read_bag(tmp_path / f"to_{end}"), SHORT))
        assert [p.number for p in told] == [n for n in range(1, end + 2) if n != learned + 1]
        assert told[learned].model.version >= steps[learned].model.version
        assert [p.number for p in told if p.behind_gap] == [learned + 2]
        twin = Twin.from_settings(SHORT, given)
        recalled(twin, told)
        assert twin.adaptor.model.version == steps[end].adaptation.model_version


def test_what_stays_incomplete_for_long_is_passed_over(tmp_path):
    """A recorder that was away for longer than messages are sent again left a gap for good."""
    given = settings(model="physics", experiments=WINDOW + 10)
    steps = list(Twin.from_settings(SHORT, given).steps(experiments(given)))
    with BagWriter(tmp_path / "run", "rotor") as writer:
        for step in steps:
            if step.experiment.number == 5:
                writer.write("signal", step.signal, step.experiment.end)
            else:
                write_step(writer, step)
    numbers = [p.experiment.number for p in complete_steps(read_bag(tmp_path / "run"), SHORT)]
    assert numbers == [n for n in range(1, WINDOW + 11) if n != 5]


@pytest.mark.slow
def test_a_recording_of_another_detector_or_model_is_refused(tmp_path):
    """The answers would not be those of the run that is to go on."""
    usual = {"model": "linear", "order": 1, "detector": "threshold"}
    given = settings(**usual)
    told = list(complete_steps(recorded(tmp_path / "run", given, experiments(given)), SHORT))
    for other, error, words in (
        ({"threshold": 0.1, "warning_threshold": 0.05}, RecordingError, "signal"),
        ({"detector": "lddm"}, RecordingError, "detector"),
        ({"model": "hybrid"}, ModelError, "kind 'hybrid'"),
    ):
        twin = Twin.from_settings(SHORT, settings(**{**usual, **other}))
        with pytest.raises(error, match=words):
            recalled(twin, told)


def test_experiments_that_the_twin_refused_do_not_hold_up_what_follows(tmp_path):
    """They are recorded, and nothing ever answers to them."""
    given = settings(model="physics", experiments=6)
    steps = list(Twin.from_settings(SHORT, given).steps(experiments(given)))
    with BagWriter(tmp_path / "run", "rotor") as writer:
        for step, number in zip(steps, itertools.count(1)):
            if number == 3:
                writer.write("experiment", step.experiment, step.experiment.end)
            else:
                write_step(writer, step)
    numbers = [p.experiment.number for p in complete_steps(read_bag(tmp_path / "run"), SHORT)]
    assert numbers == [1, 2, 4, 5, 6]


def unusable(topic):
    """A message of its type with nothing in it that could be used."""
    make = standard()
    if topic == "model":
        return make.String(data="{}")
    if topic in ("experiment", "prediction"):
        layout = make.MultiArrayLayout(dim=[], data_offset=0)
        return make.Float64MultiArray(layout=layout, data=np.zeros(3))
    header = make.Header(stamp=make.Time(sec=0, nanosec=0), frame_id="")
    return make.DiagnosticArray(header=header, status=[])


@pytest.mark.slow
def test_what_nobody_could_use_does_not_keep_a_run_from_going_on(tmp_path):
    """The recorder writes what comes, and every node refused it: one that is started again, too."""
    given = settings(model="linear", order=1, gate="none")
    steps = list(Twin.from_settings(SHORT, given).steps(experiments(given)))
    with BagWriter(tmp_path / "run", "rotor") as writer:
        for step in steps:
            write_step(writer, step)
            for name in ("experiment", "prediction", "signal", "adaptation", "model"):
                writer.write(name, unusable(name), step.experiment.end)
    bag = read_bag(tmp_path / "run")
    told = list(complete_steps(bag, SHORT))
    assert [p.experiment.number for p in told] == [s.experiment.number for s in steps]
    # Also from the middle of a long recording, where places are looked for.
    places = StepSearch(bag)
    assert places.next(0).number == steps[0].experiment.number
    assert places.next(places.of_number(5)).number <= 5
    learned = next(s.model for s in steps if s.model is not None)
    found = Lookup(bag, SHORT, given, ()).model(learned.version)
    assert same(found.record(), learned)
