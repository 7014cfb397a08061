"""Claims about learning that is switched off: it is as if the time had never been."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ldt_core.base.experiment import PAUSED, Action
from ldt_core.base.settings import resolve
from ldt_core.doctor.recording_checks import findings
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.recording.health import inspect
from ldt_core.recording.writer import BagWriter
from ldt_core.restart.learning_switch import NAME, LearningSwitch
from ldt_core.restart.recorded_run import RecordedRun, complete_steps
from ldt_core.restart.stage_restart import TwinRestart
from ldt_core.runs.offline import run, write_step
from ldt_core.twin.loop import Twin

SHORT = replace(load_machine("rotor"), duration=4.0)
OFF = range(12, 16)  # experiments


def settings(**given):
    linear = {"model": "linear", "order": 1, "detector": "threshold", "degradation": "ramp"}
    return resolve({**linear, "experiments": 24, "seed": 3, "start_time": 1e9, **given})


def made(given):
    plant = Plant.from_settings(SHORT, given)
    return [plant.experiment(n) for n in range(1, given["experiments"] + 1)]


def steps_of(twin, experiments):
    """Steps of a twin whose learning is off for some of them."""
    found = []
    for experiment in experiments:
        twin.adaptor.paused = experiment.number in OFF
        found += twin.steps([experiment])
    return found


@pytest.mark.slow
@pytest.mark.parametrize("given", [{}, {"gate": "none", "data": "warning-set"}])
def test_the_twin_goes_on_as_if_the_time_had_never_been(given):
    """Model, warning set and what is learned later are those of a twin that never saw it."""
    given = settings(**given)
    experiments = made(given)
    steps = steps_of(Twin.from_settings(SHORT, given), experiments)
    during = [s for s in steps if s.experiment.number in OFF]
    assert all(s.adaptation.details[PAUSED] == 1 and s.model is None for s in during)
    assert {s.adaptation.action for s in during} == {Action.KEPT}
    others = [s for s in steps if s not in during]
    assert any(s.model is not None for s in others[:11])
    assert any(s.model is not None for s in others[11:])
    spared = [e for e in experiments if e.number not in OFF]
    for step, alone in zip(others, Twin.from_settings(SHORT, given).steps(spared), strict=True):
        assert np.array_equal(step.prediction.speed, alone.prediction.speed)
        assert step.adaptation == alone.adaptation


@pytest.mark.slow
def test_a_run_with_such_a_time_goes_on_from_its_recording(tmp_path):
    """Recalled to any step, the twin is the one that ran through."""
    given = settings(detector="adequacy")
    experiments = made(given)
    twin = Twin.from_settings(SHORT, given)
    untrained = twin.model.record()
    steps = steps_of(twin, experiments)
    with BagWriter(tmp_path / "run", "rotor") as writer:
        writer.write("model", untrained, 1e9)
        for step in steps:
            write_step(writer, step)
    told = list(complete_steps(read_bag(tmp_path / "run"), SHORT))
    for end in (10, 12, 14, 15, 16, 20):
        again = Twin.from_settings(SHORT, given)
        restart = TwinRestart(again, RecordedRun("", "", SHORT), pytest.fail)
        for step in told[:end]:
            restart.recall(step)
        for ran, step in zip(steps[end:], steps_of(again, experiments[end:]), strict=True):
            assert ran.adaptation == step.adaptation
            assert np.array_equal(ran.prediction.speed, step.prediction.speed)


def test_a_run_that_goes_on_begins_as_its_operator_left_it(tmp_path):
    """Without a graph too; a new run learns."""
    given = settings(experiments=8, degradation="abrupt")
    experiments = made(given)
    bag = tmp_path / "run"
    run(SHORT, given, experiments[:4], bag)
    assert LearningSwitch(bag).turn(off=True)
    found = run(SHORT, {**given, "resume": str(bag)}, experiments, bag)
    assert found.notes == ["learning was switched off for a while"]
    told = [f.message for f in findings(inspect(read_bag(bag))) if f.name == "learning"]
    assert told == ["switched off, also when the run is resumed"]
    told = list(read_bag(bag).records("adaptation"))
    assert [PAUSED in a.details for a in told] == [False] * 4 + [True] * 4


def test_what_cannot_be_kept_is_told(tmp_path):
    """Where there is no recording, or no right to write."""
    assert not LearningSwitch("").turn(off=True)
    assert not LearningSwitch("").is_off
    assert not LearningSwitch(tmp_path / "nothing").turn(off=True)
    switch = LearningSwitch(tmp_path)
    assert switch.turn(off=False)
    assert switch.turn(off=True)
    assert switch.is_off
    assert (tmp_path / NAME).exists()
    assert LearningSwitch(tmp_path).turn(off=False)
    assert not switch.is_off
