"""Nodes keep checkpoints, and when they are started again they read no more than came since."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from ldt_core.base.settings import resolve
from ldt_core.machine.machine_file import load_machine
from ldt_core.runs.offline import run
from ldt_core.twin.loop import Twin
from ldt_core.twin.predictor import Predictor
from ldt_core.twin.stage import WINDOW

rclpy = pytest.importorskip("rclpy")

from stranger import answer, experiment, prediction  # noqa: E402

from ldt_ros.nodes.adaptor_node import AdaptorNode  # noqa: E402
from ldt_ros.nodes.advisor_node import AdvisorNode  # noqa: E402
from ldt_ros.nodes.detector_node import DetectorNode  # noqa: E402
from ldt_ros.nodes.experiment_source import PlantNode  # noqa: E402
from ldt_ros.nodes.stage_worker import StageWorker  # noqa: E402
from ldt_ros.nodes.twin_node import TwinNode  # noqa: E402

EVERY, COUNT, SAMPLES = 10, 345, 1000
GIVEN = {
    **{"model": "physics", "detector": "lddm", "sensor_check": False, "advice": True},
    "checkpoint_every": EVERY,
}


def made(number):
    """Of noise, which does not pack: the recording is several chunks long."""
    random = np.random.default_rng(number)
    voltage, speed = random.uniform(0, 10, SAMPLES), random.uniform(0, 5, SAMPLES)
    return replace(experiment(number), voltage=voltage, speed=speed)


MADE = [made(number) for number in range(1, COUNT + 1)]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A run without the graph, and the twin that has taken all of it."""
    folder = tmp_path_factory.mktemp("checkpoints") / "run"
    given = resolve({**GIVEN, "advice_every": 100})
    run(load_machine("rotor"), given, MADE, folder)
    twin = Twin.from_settings(load_machine("rotor"), given)
    for _ in twin.steps(MADE):
        pass
    return folder, twin


@pytest.mark.parametrize("kind", [DetectorNode, AdaptorNode, AdvisorNode])
def test_a_node_goes_on_from_a_checkpoint_of_a_run_without_the_graph(
    kind, recorded, stranger, monkeypatch
):
    """It knows the same, and has recalled what came since."""
    folder, twin = recorded
    taken = []
    recall = StageWorker.recall
    monkeypatch.setattr(
        StageWorker, "recall", lambda self, step: (taken.append(step), recall(self, step))[1]
    )
    node = stranger.start(kind, resume=str(folder), **GIVEN, advice_every=100)
    stranger.until(lambda: node.worker.finished_with == COUNT)
    # What may have been under way an advisor does again, as without checkpoints.
    again = 0 if kind is AdvisorNode else COUNT % EVERY
    assert (node.worker.restart.known, len(taken)) == (COUNT - COUNT % EVERY, again)
    stranger.until(lambda: not node.worker.busy)
    assert node.worker.restart.stage.state() == twin.stages[node.role].state()
    for number in (COUNT - WINDOW + 1, COUNT):  # what is said once more is left out
        node.pairs.pairing.right(number, None)
    assert node.pairs.pairing.repeated == 2


def test_the_twin_and_the_source_read_the_end_alone(recorded, stranger, monkeypatch):
    """Of which all follows that they have to know: the last step, and the model after it."""
    folder, twin = recorded
    taken = []
    recall = Predictor.recall
    monkeypatch.setattr(
        Predictor, "recall", lambda self, step: (taken.append(step), recall(self, step))[1]
    )
    node = stranger.start(TwinNode, resume=str(folder), **GIVEN)
    assert WINDOW <= len(taken) < COUNT
    assert node.predictor.last == COUNT
    assert node.predictor.starts == twin.predictor.starts
    assert node.predictor.model.version == twin.model.version
    assert stranger.start(PlantNode, resume=str(folder), **GIVEN).source.adapted == COUNT


def test_a_node_keeps_checkpoints_beside_the_recording(stranger, tmp_path):
    """From its first start on; where there is no recording nothing is kept."""
    node = stranger.start(DetectorNode, bag=str(tmp_path), **GIVEN)
    stranger.start(AdaptorNode, bag=str(tmp_path / "none"), **GIVEN)
    for number in range(1, 2 * EVERY + 1):
        one = experiment(number)
        stranger.send("experiment", one)
        stranger.send("prediction", prediction(number))
        stranger.send("signal", answer(number))
    stranger.until(lambda: node.worker.finished_with == 2 * EVERY)
    files = [tmp_path / f"detector.{slot}.checkpoint" for slot in (0, 1)]
    assert sorted(tmp_path.glob("*.checkpoint")) == files
    assert [json.loads(f.read_text())["experiment"] for f in files] == [EVERY, 2 * EVERY]
