"""Whoever publishes what moves the twin beside its rightful source raises an alarm."""

from __future__ import annotations

import json

import pytest

rclpy = pytest.importorskip("rclpy")

from std_msgs.msg import String  # noqa: E402
from stranger import experiment, log_of  # noqa: E402

from ldt_core.base.experiment import ModelRecord  # noqa: E402
from ldt_core.base.settings import resolve  # noqa: E402
from ldt_core.machine.machine_file import load_machine  # noqa: E402
from ldt_core.recording.model_json import model_text  # noqa: E402
from ldt_ros.graph.machine_run import MachineRun  # noqa: E402
from ldt_ros.nodes import topics as module  # noqa: E402
from ldt_ros.nodes.interfaces import message_type, qos  # noqa: E402
from ldt_ros.nodes.twin_node import TwinNode  # noqa: E402

OK, WARN, ERROR = 0, 1, 2
PHYSICS = {"model": "physics"}


@pytest.fixture
def intruder(stranger):
    """A second stranger, of another name."""
    node = rclpy.create_node("intruder", context=stranger.context)
    stranger.executor.add_node(node)
    yield node
    node.destroy_node()


@pytest.mark.parametrize("topic", ["experiment", "model"])
def test_a_second_publisher_of_another_name_is_an_alarm(stranger, intruder, topic):
    """ERROR in /diagnostics with both names, one error in the log, and a count that stays."""
    stranger.start(TwinNode, **PHYSICS)
    stranger.listen("/diagnostics")
    logged = log_of(stranger)
    stranger.publisher(topic)
    stranger.until(lambda: stranger.health("twin").get("level") == OK)
    second = intruder.create_publisher(message_type(topic), topic, qos(topic))
    words = f"more than one publisher of {topic} (/intruder, /stranger)"
    told = stranger.until(lambda: (h := stranger.health("twin")).get("level") == ERROR and h)
    assert told["message"] == words
    stranger.until(lambda: [m for m in logged if "publisher" in m.msg], "a line")
    stranger.spin(1.2)
    assert [(m.level, m.msg) for m in logged if "publisher" in m.msg] == [(40, words)]
    intruder.destroy_publisher(second)
    gone = stranger.until(lambda: (h := stranger.health("twin")).get("level") == OK and h)
    assert gone[f"second publisher of {topic}"] == "1"


def test_one_that_stays_for_less_than_a_report_is_noticed(stranger, intruder, monkeypatch):
    """Health is told once a period, here an hour; whoever comes within is counted all the same."""
    monkeypatch.setattr("ldt_ros.nodes.node.HEALTH_PERIOD", 3600.0)
    node = stranger.start(TwinNode, **PHYSICS)
    stranger.listen("/diagnostics")
    stranger.publisher("model")
    stranger.until(lambda: stranger.health("twin").get("level") == OK)
    second = intruder.create_publisher(String, "model", qos("model"))
    stranger.until(lambda: 2 in node.topics.matched)
    stranger.until(lambda: node.topics.rivals.raised)
    intruder.destroy_publisher(second)
    stranger.until(lambda: 2 not in node.topics.matched)
    assert node.topics.rivals.raised == {"model": 1}


def test_what_a_killed_node_has_left_is_no_alarm_until_it_cannot_be_that(stranger, monkeypatch):
    """Another publisher of the same name is a warning first, and an alarm after the lease."""
    monkeypatch.setattr(module, "LEASE", 1.5)
    node = stranger.start(TwinNode, **PHYSICS)
    stranger.listen("/diagnostics")
    stranger.publisher("experiment")
    stranger.publisher("experiment")
    stranger.until(lambda: stranger.health("twin").get("level") == WARN)
    assert not node.topics.rivals.raised
    stranger.until(lambda: stranger.health("twin").get("level") == ERROR)
    assert node.topics.rivals.raised == {"experiment": 1}


def test_a_topic_that_only_tells_is_a_warning(stranger, intruder):
    """Two of `adaptation`: the twin waits for one, and learns from neither."""
    node = stranger.start(TwinNode, **PHYSICS)
    stranger.listen("/diagnostics")
    for of in (stranger.node, intruder):
        of.create_publisher(message_type("adaptation"), "adaptation", 10)
    stranger.until(lambda: stranger.health("twin").get("level") == WARN)
    assert not node.topics.rivals.raised


def test_a_model_whose_digest_is_wrong_never_comes_into_force(stranger):
    """It is rejected as any other that is none, and the twin stays with what it has."""
    node = stranger.start(TwinNode, **PHYSICS)
    stranger.listen("prediction")
    good = model_text(node.predictor.model.record())
    changed = json.loads(good)
    changed["version"] = 7
    stranger.send("model", String(data=json.dumps(changed)))
    stranger.until(lambda: node.topics.rejected)
    assert node.topics.rejected == {"model: ModelError": 1}
    stranger.send("experiment", experiment(1))
    stranger.until(lambda: stranger.heard["prediction"])
    assert stranger.heard["prediction"][0].model_version == 0
    assert isinstance(node.predictor.model.record(), ModelRecord)


def test_the_summary_tells_of_the_alarm(stranger, intruder, monitor, tmp_path):
    """Into which somebody could have published a model: the run has failed."""
    node, _ = monitor
    stranger.start(TwinNode, **PHYSICS)
    stranger.publisher("model")
    intruder.create_publisher(String, "model", qos("model"))
    key = "second publisher of model"
    stranger.until(lambda: node.health["twin"].values.get(key) if "twin" in node.health else "")
    run = MachineRun("rotor", "", resolve({}), tmp_path, load_machine("rotor"))
    run.note_health(node.health, node.answered)
    words = f"a {key} in the domain (as the twin saw it): what it sent cannot be told from what"
    assert run.summary.failures == [f"{words} this run sent"]
