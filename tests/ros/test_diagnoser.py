"""The diagnosis in the graph: it answers while it works, and its verdicts are the offline run's."""

from __future__ import annotations

import threading
import time

import pytest
import yaml

import msgs_config
from ldt_core.base.experiment import Level
from ldt_core.base.settings import resolve
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.runs.offline import run

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from disturbed import LOOP, records
from stranger import adaptation, answer, experiment

from ldt_ros.nodes.diagnoser_node import DiagnoserNode

TOPICS = (*LOOP, "diagnosis")
WORN = {
    "detector": "threshold",
    "threshold": 2.0,
    "degradation": "none",
    "effect": ["unbalance:e=0.01"],
    "experiments": 2,
    "seed": 5,
    "start_time": 1.0e9,
}


@pytest.fixture(scope="module")
def rotor(tmp_path_factory) -> str:
    """Machine file of the rotor with experiments of 400 samples."""
    data = yaml.safe_load(msgs_config.machine_text("rotor"))
    data["experiment"] = {"duration": 8, "sample_period": 0.02}
    file = tmp_path_factory.mktemp("machine") / "rotor.yaml"
    file.write_text(yaml.safe_dump(data))
    return str(file)


def stream(settings, machine):
    plant = Plant.from_settings(machine, settings)
    return map(plant.experiment, range(1, settings["experiments"] + 1))


# ---- the node


class Slow:
    """In place of a diagnosis: takes its time, and can be broken off as a real one can."""

    def __init__(self) -> None:
        self.begun = threading.Event()

    def __call__(self, machine, experiments, *, workers, tick):
        self.begun.set()
        while True:
            tick("thinking")
            time.sleep(0.01)


@pytest.fixture
def slow(stranger):
    """A diagnoser node in the middle of a diagnosis that never ends, and the stranger."""
    node = stranger.start(DiagnoserNode)
    make = Slow()
    node.diagnoser.make = make
    stranger.listen("diagnosis", "/diagnostics")
    stranger.send("experiment", *(experiment(n) for n in (1, 2)))
    stranger.send("signal", answer(1, Level.POSITIVE), answer(2))
    stranger.until(make.begun.is_set, "a diagnosis that has begun")
    return node


def test_health_is_told_while_it_diagnoses_and_order_is_kept(slow, stranger):
    """What comes meanwhile waits for it."""
    stranger.until(lambda: stranger.health("diagnoser").get("diagnosing") == "true")
    told = len(stranger.heard["/diagnostics"])
    stranger.until(lambda: len(stranger.heard["/diagnostics"]) > told, "health meanwhile")
    assert stranger.health("diagnoser")["experiment"] == "0"
    slow.diagnoser.cancel()
    stranger.until(lambda: stranger.health("diagnoser").get("experiment") == "2")
    assert stranger.health("diagnoser")["no diagnosis"] == "broken off while thinking"
    assert stranger.heard["diagnosis"] == []


def test_told_to_stop_it_ends_at_once(slow):
    """This diagnosis would take for ever."""
    began = time.monotonic()
    slow.halt()
    slow.close()
    slow.worker.thread.shutdown(wait=True)
    assert time.monotonic() - began < 10
    assert slow.failure is None


def test_a_negative_costs_no_diagnosis(stranger):
    """It says how far it is, and nothing else."""
    node = stranger.start(DiagnoserNode)
    stranger.listen("diagnosis", "/diagnostics")
    stranger.send("experiment", experiment(1), experiment(2))
    stranger.send("signal", answer(1), answer(2, Level.WARNING))
    stranger.until(lambda: stranger.health("diagnoser").get("experiment") == "2")
    assert stranger.heard["diagnosis"] == []
    assert node.health()["diagnoses"] == 0


def test_the_end_of_a_run_waits_for_the_diagnoser(monitor, stranger):
    """Until it has dealt with the last experiment that was judged."""
    node, _ = monitor

    def health(name: str, **values: str) -> DiagnosticArray:
        pairs = [KeyValue(key=k, value=v) for k, v in values.items()]
        return DiagnosticArray(status=[DiagnosticStatus(name=name, values=pairs)])

    stranger.send("signal", answer(1, Level.POSITIVE))
    stranger.send("adaptation", adaptation(1))
    stranger.send("/diagnostics", health("player", experiment="1", finished="true"))
    stranger.until(lambda: node.idle, "an end without a diagnoser")
    stranger.send("/diagnostics", health("diagnoser", experiment="0", diagnosing="true"))
    stranger.until(lambda: node.busy)
    assert not node.idle
    stranger.send("/diagnostics", health("diagnoser", experiment="1", diagnosing="false"))
    stranger.until(lambda: node.idle and not node.busy)


# ---- the graph


def test_the_graph_publishes_and_records_the_verdict_of_the_offline_run(domain, rotor, tmp_path):
    """The node beside the loop; the rest of the run is as without it."""
    from ldt_ros.up import launch

    given = {**WORN, "machine": rotor, "model": "physics", "diagnose": True}
    settings = resolve({**given, "bag": str(tmp_path / "graph")})
    machine = load_machine(rotor)
    (graph,) = launch(settings)
    offline = run(machine, settings, stream(settings, machine), tmp_path / "offline")
    heard = records(tmp_path / "graph", TOPICS)
    assert heard == records(tmp_path / "offline", TOPICS)
    (first, *_) = heard["diagnosis"]
    assert first["experiment"] == 1
    assert first["effects"] == ("unbalance",)
    assert first["sentence"].startswith("Unbalance (e = ")
    assert graph.summary.as_dict()["diagnoses"] == offline.as_dict()["diagnoses"] != []


def test_the_adaptor_diagnoses_for_a_model_that_learns_by_it(domain, rotor, tmp_path):
    """Graph, offline run and replay: the same verdicts, models and words, two experiments later."""
    from ldt_ros.up import launch

    given = {**WORN, "machine": rotor, "model": "diagnosed", "cause": "auto", "diagnose": True}
    given |= {"experiments": 4, "diagnosis_after": 2}
    settings = resolve({**given, "bag": str(tmp_path / "graph")})
    machine = load_machine(rotor)
    launch(settings)
    run(machine, settings, stream(settings, machine), tmp_path / "offline")
    played = read_bag(tmp_path / "graph").experiments()
    run(machine, settings, played, tmp_path / "replay")
    heard = records(tmp_path / "graph", TOPICS)
    assert heard == records(tmp_path / "offline", TOPICS)
    assert heard == records(tmp_path / "replay", TOPICS)
    (first, *_) = heard["diagnosis"]
    assert (first["values"]["asked_at"], first["experiment"]) == (1, 3)
    reasons = [told["reason"] for told in heard["adaptation"]]
    assert "no diagnosis has named a cause yet" in reasons[1]
    assert "unbalance has grown to 10 mm; version 1" in reasons[2]


def test_each_machine_of_a_fleet_has_its_own_diagnosis(domain, rotor, tmp_path):
    """Under its namespace, from its own experiments."""
    from ldt_ros.up import launch

    given = {**WORN, "machine": rotor, "model": "physics", "diagnose": True, "experiments": 1}
    runs = launch({**given, "machines": 2, "bag": str(tmp_path / "fleet")})
    found = [records(r.bag, ("diagnosis",), r.namespace)["diagnosis"] for r in runs]
    assert [[d["effects"] for d in of_one] for of_one in found] == [[("unbalance",)]] * 2
    assert found[0][0]["values"] != found[1][0]["values"]


def test_without_being_asked_for_there_is_no_diagnosis(domain, rotor, tmp_path):
    """It costs seconds."""
    from ldt_ros.up import launch

    given = {**WORN, "machine": rotor, "model": "physics"}
    (graph,) = launch({**given, "bag": str(tmp_path / "graph")})
    assert graph.settings["graph"] == ["recorder", "adaptor", "detector", "twin", "plant"]
    assert list(read_bag(graph.bag).records("diagnosis")) == []
