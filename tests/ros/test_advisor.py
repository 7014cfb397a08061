"""The advice in the graph: it is the offline run's, comes when it is due, and nothing listens."""

from __future__ import annotations

import pytest

import msgs_config
from ldt_core.base.experiment import ModelRecord
from ldt_core.base.settings import resolve
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.runs.offline import run

pytest.importorskip("rclpy")

from stranger import adaptation, experiment

from ldt_ros.nodes.advisor_node import AdvisorNode


def model(version: int, e: float = 0.01) -> ModelRecord:
    cause = {"effect": "unbalance", "parameters": {"e": e}}
    return ModelRecord(version, "diagnosed", (1,), {"cause": cause})


def test_no_node_listens_to_advice_but_the_recorder():
    """Advice, never a command."""
    assert msgs_config.topics()["advice"]["subscriber"] == ["recorder"]


def test_it_waits_for_the_model_that_the_adaptation_names(stranger):
    """And says nothing more before the next is due."""
    stranger.start(AdvisorNode, advice_every=2)
    stranger.listen("advice", "/diagnostics")
    stranger.send("experiment", *(experiment(n, 14.0) for n in (1, 2, 3)))
    stranger.send("adaptation", *(adaptation(n, 2) for n in (1, 2, 3)))
    stranger.spin(0.5)
    assert stranger.heard["advice"] == []
    stranger.send("model", model(2))
    stranger.until(lambda: stranger.health("advisor").get("experiment") == "3")
    stranger.until(lambda: len(stranger.heard["advice"]) == 2)
    assert stranger.numbers("advice") == [1, 3]
    assert all(a.warning and "Do not hold" in a.sentence for a in stranger.heard["advice"])


def test_a_model_that_is_none_brings_no_advice(stranger):
    """It is said, and the node goes on."""
    stranger.start(AdvisorNode, advice_every=1)
    stranger.listen("advice", "/diagnostics")
    stranger.send("model", ModelRecord(1, "diagnosed", (), {}), model(2))
    stranger.send("experiment", experiment(1))
    stranger.send("adaptation", adaptation(1, 1))
    told = stranger.until(lambda: stranger.health("advisor").get("no advice"))
    assert "parameters.cause" in told
    stranger.send("experiment", experiment(2))
    stranger.send("adaptation", adaptation(2, 2))
    stranger.until(lambda: stranger.numbers("advice") == [2])


def test_the_graph_publishes_and_records_the_advice_of_the_offline_run(
    domain, short_rotor, tmp_path
):
    """By what the diagnosed model has learned."""
    from ldt_ros.up import launch

    given = {
        "machine": short_rotor,
        "model": "diagnosed",
        "detector": "threshold",
        "threshold": 2.0,
        "degradation": "none",
        "effect": ["unbalance:e=0.01"],
        "experiments": 4,
        "seed": 5,
        "start_time": 1.0e9,
        "advice": True,
        "advice_every": 3,
    }
    settings = resolve({**given, "bag": str(tmp_path / "graph")})
    machine = load_machine(short_rotor)
    (graph,) = launch(settings)
    plant = Plant.from_settings(machine, settings)
    offline = run(machine, settings, map(plant.experiment, range(1, 5)), tmp_path / "offline")
    roles = ["recorder", "advisor", "adaptor", "detector", "twin", "plant"]
    assert graph.settings["graph"] == roles
    heard = list(read_bag(tmp_path / "graph").records("advice"))
    assert heard == list(read_bag(tmp_path / "offline").records("advice"))
    assert [a.experiment for a in heard] == [1, 4]
    assert heard[-1].values["eccentricity"] == pytest.approx(0.01, rel=0.1)
    assert graph.summary.as_dict()["advice"] == offline.as_dict()["advice"]
