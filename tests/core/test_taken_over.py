"""A run that goes on takes over what its signals say, and is then where it was, to the last bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ldt_core.base.settings import resolve
from ldt_core.detectors.adequacy import Adequacy
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import BagWriter
from ldt_core.restart.recorded_run import complete_steps
from ldt_core.runs import offline
from ldt_core.twin.loop import Twin

COUNT = 40
SHORT = replace(load_machine("rotor"), duration=1.0)
#: What the experiments are like, and what takes them.
RUNS = {
    "holds": {"model": "auto"},
    "changes": {"model": "auto", "degradation": "staircase"},
    "learns alone": {"model": "linear", "order": 1},
    "claims not to know": {"model": "hybrid", "degradation": "ramp"},
    "inadequate": {"model": "physics"},
    "inadequate beyond a limit": {"model": "physics", "false_alarm_every": 50.0},
    "coarse": {"model": "auto"},
}


def experiments(name, given):
    """Of the short rotor, a coarse sensor's, and in the middle some of a greater voltage."""
    plant = Plant.from_settings(SHORT, given)
    for number in range(1, COUNT + 1):
        one = plant.experiment(number)
        if name == "coarse" and number % 4:
            one = replace(one, speed=np.round(one.speed / 0.5) * 0.5)
        yield one


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.slow] * (g["model"] == "auto")) for n, g in RUNS.items()],
)
def test_the_state_is_the_same_after_every_step(name, tmp_path, monkeypatch):
    """Whatever the states that it goes through."""
    given = resolve({"seed": 3, "start_time": 1e9, "checkpoint_every": 0, **RUNS[name]})
    states = []
    twin = Twin.from_settings(SHORT, given)
    with BagWriter(tmp_path / "run", SHORT.name) as writer:
        for step in twin.steps(experiments(name, given), pytest.fail):
            offline.write_step(writer, step)
            states.append({role: stage.state() for role, stage in twin.stages.items()})

    computed = []
    judge = Adequacy.judge
    monkeypatch.setattr(
        Adequacy, "judge", lambda self, *row: (computed.append(row), judge(self, *row))[1]
    )
    again = Twin.from_settings(SHORT, given)
    for step, state in zip(complete_steps(read_bag(tmp_path / "run"), SHORT), states, strict=True):
        for role, stage in again.stages.items():
            stage.recall(step)
            assert stage.state() == state[role], (step, role)
    assert len(computed) < 0.6 * COUNT
