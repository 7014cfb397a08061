"""Graph, offline run and replay of one stream give the same numbers, to the last bit."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from disturbed import records
from threadpoolctl import threadpool_limits

from ldt_core.base.experiment import Experiment
from ldt_core.base.settings import resolve
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import BagWriter
from ldt_core.runs.offline import run

pytest.importorskip("rclpy")

RUNS = {
    "linear, threshold": {"model": "linear", "detector": "threshold", "threshold": 2.0},
    "hybrid, lddm": {"model": "hybrid", "detector": "lddm", "error_threshold": 0.5},
    "hybrid of speed and voltage, window, no gate": {
        "model": "hybrid",
        "detector": "window",
        "window": 4,
        "gp_inputs": ["speed", "voltage"],
        "gate": "none",
    },
    "diagnosed, adequacy": {
        "model": "diagnosed",
        "detector": "adequacy",
        "degradation": "none",
        "effect": ["unbalance:e=0.01"],  # so wrong from the start that it is noticed at once
    },
    "no model that learns, never": {"model": "physics", "detector": "never"},
}
COMMON = {"experiments": 6, "seed": 5, "start_time": 1.0e9, "measure_current": False}


@pytest.mark.parametrize("name", RUNS)
def test_graph_offline_run_and_replay_agree_bit_for_bit(name, domain, tmp_path):
    """Every experiment, prediction, signal, model and adaptation is the same in all three."""
    from ldt_ros.up import launch

    settings = resolve({**COMMON, **RUNS[name], "bag": str(tmp_path / "graph")})
    machine = load_machine("rotor")
    plant = Plant.from_settings(machine, settings)
    numbers = range(1, settings["experiments"] + 1)

    launch(settings)
    with threadpool_limits(2):  # as outside of the graph; its nodes have one thread
        run(machine, settings, map(plant.experiment, numbers), tmp_path / "offline")
        played = read_bag(tmp_path / "graph").experiments()
        run(machine, settings, played, tmp_path / "replay")

    graph = records(tmp_path / "graph")
    assert len(graph["adaptation"]) == settings["experiments"]
    learned = [a for a in graph["adaptation"] if a["action"] == "adapted"]
    assert bool(learned) == (settings["detector"] != "never")
    assert graph == records(tmp_path / "offline")
    assert graph == records(tmp_path / "replay")


def spoiled(machine: Machine, folder: Path) -> Path:
    """A recording with an impossible experiment, its correction, a repetition and a step back."""
    plant = Plant(machine, experiments=9, seed=2, start_time=1.0e9)
    with BagWriter(folder, machine=machine.name) as writer:
        for number in (1, -2, 2, 3, 3, 6, 5, 7, -8, 9):
            good = plant.experiment(abs(number))
            bad = Experiment(good.number, good.start, good.period, 10 * good.voltage, good.speed)
            kept = good if number > 0 else bad
            writer.write("experiment", kept, kept.end)
    return folder


def test_what_cannot_be_used_is_left_out_alike(domain, short_rotor, tmp_path):
    """Graph and offline run judge, learn from, reject and sum up the same experiments.

    For one that stands there again no adaptation comes, and none is waited for.
    """
    from ldt_ros.up import launch

    machine = load_machine(short_rotor)
    played = spoiled(machine, tmp_path / "spoiled")
    learns = {"model": "hybrid", "detector": "threshold", "threshold": 1.0}
    learns |= {"adaptation_timeout": 200.0}
    settings = resolve({**learns, "machine": short_rotor, "play": str(played)})
    began = time.monotonic()
    (graph,) = launch({**settings, "bag": str(tmp_path / "graph")})
    assert time.monotonic() - began < settings["adaptation_timeout"]
    experiments = read_bag(played).experiments()
    offline = run(machine, settings, experiments, tmp_path / "offline")
    figures = [{k: v for k, v in s.as_dict().items() if k != "notes"} for s in
               (graph.summary, offline)]  # fmt: skip
    assert figures[0] == figures[1]
    assert offline.experiments == 6
    assert (offline.rejected, offline.repeated) == (3, 1)
    assert offline.adaptations > 0
    predicted = records(tmp_path / "graph")
    for topic in ("prediction", "original_prediction", "signal", "model", "adaptation"):
        assert predicted[topic] == records(tmp_path / "offline")[topic]
