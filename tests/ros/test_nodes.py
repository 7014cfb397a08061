"""Each node alone, over real DDS: what it does with good messages, and with bad ones."""

from __future__ import annotations

import array
import json
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.experiment import Action, Adaptation, Level, ModelRecord, Prediction, Signal
from ldt_core.machine import load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import BagWriter

rclpy = pytest.importorskip("rclpy")

from conftest import LENGTH, PERIOD, TOPICS, Stranger, experiment  # noqa: E402
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String  # noqa: E402

from ldt_ros.adaptor_node import AdaptorNode  # noqa: E402
from ldt_ros.convert import to_message  # noqa: E402
from ldt_ros.detector_node import DetectorNode  # noqa: E402
from ldt_ros.monitor import Monitor  # noqa: E402
from ldt_ros.pairing import Pairing  # noqa: E402
from ldt_ros.plant_node import PlantNode  # noqa: E402
from ldt_ros.player_node import PlayerNode  # noqa: E402
from ldt_ros.recorder_node import RecorderNode  # noqa: E402
from ldt_ros.twin_node import PredictorNode  # noqa: E402

PHYSICS = {"model": "physics"}
WRONG_NUMBERS = {  # place in data → values that cannot be
    0: [0.0, 1.5, -1.0, np.nan, np.inf],  # experiment number
    1: [np.nan],  # start
    2: [0.0, -0.01, np.inf],  # sample period
    5: [np.nan, np.inf, -np.inf],  # a sample
}


def prediction(number: int, speed: float = 0.0, length: int = LENGTH) -> Prediction:
    return Prediction(number, 1e9 + 100 * number, PERIOD, 0, np.full(length, speed))


def answer(number: int, level: Level = Level.NEGATIVE) -> Signal:
    return Signal(number, level, "threshold", 0, 1.0)


def adaptation(number: int, version: int = 0) -> Adaptation:
    return Adaptation(number, Action.KEPT, version, "because")


def bad_arrays(good: Float64MultiArray, columns: str) -> dict[str, Float64MultiArray]:
    """Name → a message that differs from a good one in one respect."""
    result = {}

    def variant(name: str, change) -> None:
        message = Float64MultiArray()
        message.layout.data_offset = good.layout.data_offset
        message.layout.dim = [
            MultiArrayDimension(label=d.label, size=d.size, stride=d.stride)
            for d in good.layout.dim
        ]
        message.data = array.array("d", good.data)
        change(message)
        result[name] = message

    def put(message, at, value) -> None:
        message.data[at] = value

    variant("nothing at all", lambda m: (setattr(m.layout, "dim", []), setattr(m, "data", [])))
    variant("no layout", lambda m: setattr(m.layout, "dim", []))
    variant("no data", lambda m: setattr(m, "data", []))
    variant("label of the rows", lambda m: setattr(m.layout.dim[0], "label", "row"))
    variant("missing channel", lambda m: setattr(m.layout.dim[1], "label", columns))
    variant("channel twice", lambda m: setattr(m.layout.dim[1], "label", "speed,speed"))
    variant("number of rows", lambda m: setattr(m.layout.dim[0], "size", LENGTH + 1))
    variant("no rows", lambda m: setattr(m.layout.dim[0], "size", 0))
    variant("number of channels", lambda m: setattr(m.layout.dim[1], "size", 7))
    variant("stride of the rows", lambda m: setattr(m.layout.dim[0], "stride", 1))
    variant("stride of the channels", lambda m: setattr(m.layout.dim[1], "stride", 7))
    variant("offset", lambda m: setattr(m.layout, "data_offset", 0))
    variant("one number short", lambda m: m.data.pop())
    variant("ten megabytes", lambda m: m.data.extend([1.0] * 1_300_000))
    for at, values in WRONG_NUMBERS.items():
        for value in values:
            variant(f"data[{at}] = {value}", lambda m, at=at, value=value: put(m, at, value))
    return result


def bad_statuses(good: DiagnosticArray) -> dict[str, DiagnosticArray]:
    """Name → a status message that differs from a good one in one respect."""
    status = good.status[0]
    values = {v.key: v.value for v in status.values}

    def variant(level: bytes = status.level, word: str = status.message, **changes: str | None):
        changed = {k: v for k, v in {**values, **changes}.items() if v is not None}
        pairs = [KeyValue(key=k, value=v) for k, v in changed.items()]
        return DiagnosticArray(status=[DiagnosticStatus(level=level, message=word, values=pairs)])

    twice = variant()
    twice.status[0].values.append(KeyValue(key="experiment", value="2"))
    return {
        "no status": DiagnosticArray(),
        "two statuses": DiagnosticArray(status=[status, status]),
        "empty status": DiagnosticArray(status=[DiagnosticStatus()]),
        "word": variant(word="perhaps"),
        "no experiment": variant(experiment=None),
        "experiment of letters": variant(experiment="seven"),
        "experiment 0": variant(experiment="0"),
        "experiment of 5000 digits": variant(experiment="9" * 5000),
        "version -1": variant(model_version="-1"),
        "no version": variant(model_version=None),
        "a key twice": twice,
    }


def bad_models() -> dict[str, String]:
    """Name → a text that is no model of the default machine."""
    good = {"version": 1, "kind": "physics", "trained_on": [1], "parameters": {}}
    machine = dict(load_machine("rotor").parameters)

    def variant(**changes) -> str:
        return json.dumps({k: v for k, v in {**good, **changes}.items() if v is not None})

    texts = {
        "empty": "",
        "half": '{"version": 1,',
        "a list": "[]",
        "null": "null",
        "nested deep": "[" * 100_000,
        "nested deep in the parameters": variant().replace("{}", '{"a":' * 5000 + "1" + "}" * 5000),
        "integer of 5000 digits": variant(version=1).replace("1", "9" * 5000, 1),
        "integer as parameter that no float holds": variant(
            parameters={"machine": {**machine, "J": 10**400}}
        ),
        "NaN": variant(parameters={"machine": {**machine, "J": float("nan")}}),
        "infinity": variant(parameters={"machine": {**machine, "J": float("inf")}}),
        "1e999": variant().replace("{}", '{"machine": {"J": 1e999}}'),
        "another kind": variant(kind="linear"),
        "no kind": variant(kind=None),
        "kind is a number": variant(kind=5),
        "version is true": variant(version=True),
        "version below 0": variant(version=-1),
        "trained on 0": variant(trained_on=[0]),
        "no parameters": variant(),
        "parameters are no mapping": variant(parameters=[1]),
        "parameters of a wrong type": variant(parameters={"machine": 5}),
        "unknown parameter": variant(parameters={"machine": {**machine, "mass": 1.0}}),
        "missing parameter": variant(parameters={"machine": {"J": 0.1}}),
        "negative mass": variant(parameters={"machine": {**machine, "m": -1.0}}),
        "ten megabytes": "x" * 10_000_000,
        "many keys": json.dumps(dict.fromkeys(map(str, range(100_000)))),
    }
    return {name: String(data=text) for name, text in texts.items()}


def every_one_is_rejected(stranger: Stranger, node, topic: str, messages: dict) -> None:
    """Each message adds one to the node's count of rejections on the topic."""
    stranger.listen("/diagnostics")
    logged = log_of(stranger)
    for count, (name, message) in enumerate(messages.items(), start=1):
        stranger.send(topic, message)
        stranger.until(lambda c=count: sum(node.rejected.values()) >= c, f"rejection of: {name}")
        assert sum(node.rejected.values()) == count, name
    told = stranger.until(lambda: _told(stranger, node, len(messages)), "count in /diagnostics")
    assert told["level"] == 1  # WARN
    assert len(told["last rejection"]) < 500
    kinds = [key for key in told if key.startswith("rejected ")]
    assert all(key.startswith(f"rejected {topic}: ") for key in kinds)
    stranger.spin(0.2)
    assert len([m for m in logged if m.name.endswith(node.role)]) == len(kinds)


def _told(stranger: Stranger, node, count: int) -> dict[str, str]:
    told = stranger.health(node.role)
    rejected = sum(int(v) for k, v in told.items() if k.startswith("rejected "))
    return told if rejected == count else {}


def log_of(stranger: Stranger) -> list:
    """Whatever is logged from now on."""
    from rcl_interfaces.msg import Log

    lines: list = []
    stranger.node.create_subscription(Log, "/rosout", lines.append, 100)
    stranger.spin(0.1)
    return lines


# ---- bad messages


@pytest.mark.parametrize("kind", [PredictorNode, DetectorNode, AdaptorNode])
def test_what_is_no_experiment_is_counted_logged_once_a_kind_and_the_node_goes_on(kind, stranger):
    """Layout, labels, sizes, strides, offset, head, samples; then a good one is taken."""
    parameters = {} if kind is DetectorNode else PHYSICS
    node = stranger.start(kind, **parameters)
    good = to_message(experiment(1))
    every_one_is_rejected(stranger, node, "experiment", bad_arrays(good, "voltage,torque"))
    before = node.counts["experiment"]
    stranger.send("experiment", good)
    stranger.until(lambda: node.counts["experiment"] > before)
    assert sum(node.rejected.values()) == before
    if kind is PredictorNode:
        assert node.predictor.last == 1


def test_what_is_no_prediction_is_rejected_by_the_detector(stranger):
    """As for experiments; a prediction of another length than its experiment as well."""
    node = stranger.start(DetectorNode)
    bad = bad_arrays(to_message(prediction(1)), "torque,speed_std")
    # A prediction has one number more before its samples.
    negative = to_message(Prediction(1, 1e9, PERIOD, 0, np.zeros(3), np.ones(3)))
    negative.data[5] = -1.0
    bad["negative deviation"] = negative
    every_one_is_rejected(stranger, node, "prediction", bad)
    stranger.listen("signal")
    stranger.send("experiment", experiment(1), experiment(2))
    stranger.send("prediction", prediction(1, length=LENGTH + 1), prediction(2))
    stranger.until(lambda: stranger.numbers("signal") == [2], "signal 2 alone")
    assert sum(node.rejected.values()) == len(bad) + 1


def test_what_is_no_signal_is_rejected_by_the_adaptor(stranger):
    """Statuses, levels, words, keys, numbers."""
    node = stranger.start(AdaptorNode, **PHYSICS)
    good = to_message(answer(1))
    bad = bad_statuses(good)
    wrong_level, no_number = to_message(answer(1)), to_message(answer(1))
    wrong_level.status[0].level = bytes([9])
    no_number.status[0].values[-1] = KeyValue(key="max_error", value="nan")
    every_one_is_rejected(
        stranger, node, "signal", {**bad, "level": wrong_level, "max_error": no_number}
    )
    stranger.listen("adaptation")
    stranger.send("experiment", experiment(1))
    stranger.send("signal", good)
    stranger.until(lambda: stranger.numbers("adaptation") == [1])


def test_what_is_no_adaptation_is_rejected_by_the_twin(stranger):
    """The twin goes on waiting for the right one."""
    node = stranger.start(PredictorNode, **PHYSICS)
    every_one_is_rejected(stranger, node, "adaptation", bad_statuses(to_message(adaptation(1))))
    stranger.listen("prediction")
    stranger.send("experiment", experiment(1), experiment(2))
    stranger.until(lambda: stranger.numbers("prediction") == [1])
    stranger.send("adaptation", adaptation(7), adaptation(1))
    stranger.until(lambda: stranger.numbers("prediction") == [1, 2])


def test_what_is_no_adaptation_is_rejected_by_the_player(stranger, tmp_path):
    """The player goes on waiting for the right one."""
    stranger.listen("experiment")
    node = stranger.start(PlayerNode, play=written(tmp_path / "bag", 1, 2))
    stranger.until(lambda: stranger.numbers("experiment") == [1])
    every_one_is_rejected(stranger, node, "adaptation", bad_statuses(to_message(adaptation(1))))
    assert stranger.numbers("experiment") == [1]
    stranger.send("adaptation", adaptation(7), adaptation(1))
    stranger.until(lambda: stranger.numbers("experiment") == [1, 2])


def test_what_is_no_model_is_rejected_by_the_twin(stranger):
    """JSON and parameters of every wrong sort; nothing of it comes into force."""
    node = stranger.start(PredictorNode, **PHYSICS)
    every_one_is_rejected(stranger, node, "model", bad_models())
    stranger.listen("prediction")
    stranger.send("experiment", experiment(1))
    stranger.until(lambda: stranger.heard["prediction"])
    assert stranger.heard["prediction"][0].model_version == 0


def test_experiments_that_cannot_be_are_refused_by_number(stranger):
    """Voltage outside the limits, the same number again, a lower one: told in /diagnostics."""
    node = stranger.start(PredictorNode, **PHYSICS)
    stranger.listen("prediction", "/diagnostics")
    stranger.send("experiment", experiment(3))
    stranger.until(lambda: stranger.numbers("prediction") == [3])
    stranger.send("adaptation", adaptation(3))
    for bad in (experiment(3), experiment(2), experiment(4, voltage=30.0)):
        began = time.monotonic()
        stranger.send("experiment", bad)
        number = str(bad.number)
        stranger.until(lambda n=number: stranger.health("twin").get("refused experiment") == n)
        assert time.monotonic() - began < 0.5  # at once, not with the next report
    assert node.rejected == {"experiment: ExperimentError": 3}
    assert "-24 to 24 V (limits of machine 'rotor')" in stranger.health("twin")["last rejection"]
    stranger.send("experiment", experiment(4))
    stranger.until(lambda: stranger.numbers("prediction") == [3, 4])


def test_a_second_publisher_is_warned_of(stranger):
    """WARN in /diagnostics that names the topic, and one line in the log; gone, all is well."""
    stranger.start(PredictorNode, **PHYSICS)
    stranger.listen("/diagnostics")
    logged = log_of(stranger)
    stranger.publisher("experiment")
    stranger.until(lambda: stranger.health("twin").get("level") == 0)
    second = stranger.publisher("experiment")
    told = stranger.until(lambda: (h := stranger.health("twin")).get("level") == 1 and h)
    assert told["message"] == "more than one publisher of experiment"
    stranger.spin(1.2)
    assert len([m for m in logged if "more than one publisher" in m.msg]) == 1
    stranger.node.destroy_publisher(second)
    stranger.until(lambda: stranger.health("twin").get("level") == 0)


# ---- the twin's order


def test_the_twin_predicts_after_the_adaptation_of_the_one_before(stranger):
    """However early the experiments come."""
    stranger.start(PredictorNode, **PHYSICS)
    stranger.listen("prediction")
    stranger.send("experiment", *(experiment(n) for n in (1, 2, 3)))
    stranger.until(lambda: stranger.numbers("prediction") == [1])
    stranger.spin(0.3)
    assert stranger.numbers("prediction") == [1]
    stranger.send("adaptation", adaptation(1))
    stranger.until(lambda: stranger.numbers("prediction") == [1, 2])
    stranger.spin(0.2)
    assert stranger.numbers("prediction") == [1, 2]
    stranger.send("adaptation", adaptation(2))
    stranger.until(lambda: stranger.numbers("prediction") == [1, 2, 3])


def model_record(version: int) -> ModelRecord:
    parameters = {**load_machine("rotor").parameters, "J": 0.02 + version / 100}
    return ModelRecord(version, "physics", (1,), {"machine": parameters})


def test_the_twin_awaits_a_model_that_comes_after_its_adaptation(stranger):
    """The two topics have no common order; the adaptation says which model is meant."""
    stranger.start(PredictorNode, **PHYSICS)
    stranger.listen("prediction")
    stranger.send("experiment", experiment(1), experiment(2))
    stranger.send("adaptation", adaptation(1, version=1))
    stranger.spin(0.3)
    assert stranger.numbers("prediction") == [1]
    stranger.send("model", model_record(1))
    stranger.until(lambda: stranger.numbers("prediction") == [1, 2])
    assert [p.model_version for p in stranger.heard["prediction"]] == [0, 1]
    first, second = (p.speed for p in stranger.heard["prediction"])
    assert not np.array_equal(first, second)


def test_a_model_is_not_used_before_an_adaptation_names_it(stranger):
    """It may come before the adaptation, which may yet refuse it."""
    stranger.start(PredictorNode, **PHYSICS)
    stranger.listen("prediction")
    stranger.send("experiment", experiment(1))
    stranger.until(lambda: stranger.numbers("prediction") == [1])
    stranger.send("model", model_record(1))
    stranger.send("adaptation", adaptation(1, version=0))
    stranger.send("experiment", experiment(2))
    stranger.until(lambda: stranger.numbers("prediction") == [1, 2])
    assert stranger.heard["prediction"][1].model_version == 0


def test_without_an_adaptation_the_twin_goes_on_after_its_time_out_and_says_so(stranger):
    """With the model it has; logged and counted."""
    stranger.start(PredictorNode, **PHYSICS, adaptation_timeout=0.3)
    stranger.listen("prediction", "/diagnostics")
    logged = log_of(stranger)
    stranger.send("experiment", experiment(1), experiment(2))
    began = time.monotonic()
    stranger.until(lambda: stranger.numbers("prediction") == [1, 2])
    assert time.monotonic() - began > 0.25
    stranger.until(lambda: stranger.health("twin").get("adaptation time-outs") == "1")
    lines = [m.msg for m in logged if "no adaptation of experiment 1 within 0.3 s" in m.msg]
    assert len(lines) == 1
    assert "experiment 2 is predicted by model 0" in lines[0]


def test_a_twin_that_joins_late_has_the_model_in_force(stranger):
    """The models are latched; the last of them predicts the first experiment that it sees."""
    from ldt_ros.interfaces import qos

    early = stranger.node.create_publisher(String, "model", qos("model"))
    for version in (1, 2):
        early.publish(to_message(model_record(version)))
    node = stranger.start(PredictorNode, **PHYSICS)
    stranger.until(lambda: node.counts["model"] == 2, "latched models")
    stranger.listen("prediction")
    stranger.send("experiment", experiment(9))
    stranger.until(lambda: stranger.numbers("prediction") == [9])
    assert stranger.heard["prediction"][0].model_version == 2


# ---- the adaptor

SLOW = '''
"""A model that takes its time to learn."""

import threading

from ldt_core.models.physics import PhysicsModel

GO_ON = threading.Event()


class SlowModel(PhysicsModel):
    kind = "slow"
    adaptive = True

    def fit(self, experiments):
        if not GO_ON.wait(20):
            raise RuntimeError("nobody let it go on")
        return self.successor(self.parameters, experiments)


class BrokenModel(SlowModel):
    kind = "broken"

    def fit(self, experiments):
        raise AssertionError("a fault of the user's model")
'''


@pytest.fixture
def models(tmp_path) -> Path:
    """A file with a model that learns only when it is let, and one that cannot."""
    file = tmp_path / "models.py"
    file.write_text(SLOW)
    return file


def test_health_is_told_while_the_adaptor_trains_and_order_is_kept(stranger, models):
    """Training is on a thread of its own; what comes meanwhile waits for it."""
    node = stranger.start(AdaptorNode, model=f"{models}:SlowModel", gate="none")
    stranger.listen("adaptation", "model", "/diagnostics")
    stranger.send("experiment", *(experiment(n) for n in (1, 2, 3)))
    stranger.send("signal", answer(1, Level.POSITIVE), answer(2), answer(3, Level.WARNING))
    stranger.until(lambda: stranger.health("adaptor").get("training") == "true")
    told = len(stranger.heard["/diagnostics"])
    stranger.until(lambda: len(stranger.heard["/diagnostics"]) > told, "health during training")
    assert stranger.heard["adaptation"] == []
    type(node.adaptor.model).fit.__globals__["GO_ON"].set()
    stranger.until(lambda: len(stranger.heard["adaptation"]) == 3)
    assert [(a.experiment, a.action) for a in stranger.heard["adaptation"]] == [
        (1, Action.ADAPTED),
        (2, Action.KEPT),
        (3, Action.STORED),
    ]
    assert {a.model_version for a in stranger.heard["adaptation"]} == {1}
    stranger.until(lambda: [m.version for m in stranger.heard["model"]] == [0, 1])
    stranger.until(lambda: stranger.health("adaptor").get("training") == "false")


def test_a_fault_of_a_users_model_ends_the_adaptor_with_its_name(stranger, models):
    """It is no bad message: waiting for an adaptation that never comes would hide it."""
    node = stranger.start(AdaptorNode, model=f"{models}:BrokenModel", gate="none")
    stranger.send("experiment", experiment(1))
    stranger.send("signal", answer(1, Level.POSITIVE))
    stranger.until(lambda: node.failure is not None)
    assert isinstance(node.failure, AssertionError)
    assert "a fault of the user's model" in str(node.failure)


def test_a_late_joiner_gets_the_model_in_force(stranger):
    """Reliable and transient-local, as the contract says."""
    stranger.start(AdaptorNode, **PHYSICS)
    stranger.spin(0.3)
    stranger.listen("model")
    stranger.until(lambda: [m.version for m in stranger.heard["model"]] == [0])
    assert stranger.heard["model"][0].kind == "physics"


def test_one_without_the_other_waits_and_the_first_of_a_number_counts(stranger):
    """Signals before their experiments; a second experiment of a number is dropped and counted."""
    stranger.start(AdaptorNode, **PHYSICS)
    stranger.listen("adaptation", "/diagnostics")
    stranger.send("signal", answer(2), answer(1))
    stranger.send("experiment", experiment(1), experiment(2), experiment(3), experiment(3))
    stranger.until(lambda: stranger.numbers("adaptation") == [1, 2])
    stranger.until(lambda: stranger.health("adaptor").get("unpaired") == "1")


# ---- plant and player


def written(folder: Path, *numbers: int, voltages: dict[int, float] | None = None) -> str:
    """A recording of experiments."""
    with BagWriter(folder, machine="rotor") as writer:
        for number in numbers:
            record = experiment(number, (voltages or {}).get(number, 10.0))
            writer.write("experiment", record, record.end)
    return str(folder)


def test_the_player_sends_the_next_after_the_adaptation_of_the_last(stranger, tmp_path):
    """And has finished after the last one's."""
    stranger.listen("experiment", "/diagnostics")
    node = stranger.start(PlayerNode, play=written(tmp_path / "bag", 1, 2))
    stranger.until(lambda: stranger.numbers("experiment") == [1])
    stranger.send("adaptation", adaptation(2), adaptation(9))
    stranger.spin(0.3)
    assert stranger.numbers("experiment") == [1]
    stranger.send("adaptation", adaptation(1))
    stranger.until(lambda: stranger.numbers("experiment") == [1, 2])
    assert not node.finished
    stranger.send("adaptation", adaptation(2))
    stranger.until(lambda: stranger.health("player").get("finished") == "true")


def test_without_an_adaptation_the_player_goes_on_after_its_time_out(stranger, tmp_path):
    """And says so."""
    logged = log_of(stranger)
    stranger.listen("experiment")
    stranger.start(PlayerNode, play=written(tmp_path / "bag", 1, 2), adaptation_timeout=0.2)
    stranger.until(lambda: stranger.numbers("experiment") == [1, 2])
    stranger.until(lambda: [m for m in logged if "no adaptation of experiment 1" in m.msg])


def test_a_source_waits_for_the_nodes_of_its_graph(stranger, tmp_path):
    """Nothing is sent before all that the graph names have told that they are ready."""
    graph = ["twin", "detector", "player"]
    play = written(tmp_path / "bag", 1)
    stranger.listen("experiment")
    stranger.start(PlayerNode, play=play, graph=graph)
    stranger.start(PredictorNode, **PHYSICS, graph=graph)
    stranger.spin(0.5)
    assert stranger.numbers("experiment") == []
    stranger.start(DetectorNode, graph=graph)
    stranger.until(lambda: stranger.numbers("experiment") == [1])


def test_a_whole_graph_passes_over_experiments_that_the_twin_refuses(stranger, tmp_path):
    """At once, not after the time-out for adaptations; the last one included."""
    play = written(tmp_path / "bag", 1, 2, 3, 4, voltages={2: 99.0, 4: -99.0})
    graph = {"graph": ["detector", "adaptor", "twin", "player"]}
    stranger.listen("adaptation")
    stranger.start(DetectorNode, **graph)
    stranger.start(AdaptorNode, **PHYSICS, **graph)
    stranger.start(PredictorNode, **PHYSICS, **graph)
    player = stranger.start(PlayerNode, play=play, **graph)
    began = time.monotonic()
    stranger.until(lambda: player.finished)
    assert time.monotonic() - began < 10
    assert stranger.numbers("adaptation") == [1, 3]


def test_a_recording_that_breaks_while_it_is_played_ends_the_player(stranger, tmp_path):
    """It is a fault of the recording, not of the adaptation that asked for the next experiment."""
    stranger.listen("experiment")
    node = stranger.start(PlayerNode, play=written(tmp_path / "bag", 1, 2, 3))
    stranger.until(lambda: stranger.numbers("experiment") == [1])

    def broken():
        from ldt_core.errors import RecordingError

        raise RecordingError("bag", "an experiment", "rubbish")

    node.fetch = broken
    stranger.send("adaptation", adaptation(1))
    stranger.until(lambda: node.failure is not None)
    assert str(node.failure) == "bag: expected an experiment, got rubbish"
    assert not node.rejected


# ---- the launching process


@pytest.fixture
def monitor(stranger):
    """The launching process's ear, and the steps that it hears of."""
    steps: list = []
    node = Monitor("", lambda *step: steps.append(step), context=stranger.context)
    stranger.executor.add_node(node)
    yield node, steps
    node.destroy_node()


def test_garbage_does_not_end_the_launching_process(monitor, stranger):
    """It is the nodes' to count; what is good is taken all the same."""
    node, steps = monitor
    for name in ("plant", "player", "twin"):
        silent = DiagnosticStatus(name=name)
        wrong = DiagnosticStatus(name=name, values=[KeyValue(key="experiment", value="9" * 5000)])
        stranger.send("/diagnostics", DiagnosticArray(status=[silent, wrong]), DiagnosticArray())
    stranger.until(lambda: {"plant", "player", "twin"} <= set(node.health))
    for topic, good in {"signal": answer(1), "adaptation": adaptation(1)}.items():
        bad = bad_statuses(to_message(good)).values()
        stranger.send(topic, *bad, good, *bad)
    stranger.until(lambda: steps)
    assert len(steps) == 1
    assert node.last_experiment == 0


def test_the_launching_process_waits_for_all_that_was_sent_and_not_refused(monitor, stranger):
    """The source's word says what was sent, the twin's what was refused."""
    node, _ = monitor
    assert node.idle  # nothing has begun

    def health(name: str, **values: str) -> DiagnosticArray:
        pairs = [KeyValue(key=k.replace("_", " "), value=v) for k, v in values.items()]
        return DiagnosticArray(status=[DiagnosticStatus(name=name, values=pairs)])

    stranger.send("/diagnostics", health("player", experiment="0", finished="false"))
    stranger.until(lambda: not node.idle, "a source that has begun")
    stranger.send("/diagnostics", health("player", experiment="2", finished="true"))
    stranger.until(lambda: node.source_finished)
    assert not node.idle
    stranger.send("/diagnostics", health("twin", refused_experiment="2"))
    stranger.until(lambda: node.idle)


# ---- everyone may listen


@pytest.mark.parametrize("durability", [DurabilityPolicy.VOLATILE, None])
def test_stock_tools_can_listen_to_every_topic(durability, stranger, tmp_path):
    """Best effort and volatile as `ros2 topic echo` may be, or as the topics are declared."""
    profile = None
    if durability is not None:
        profile = QoSProfile(
            depth=50, reliability=ReliabilityPolicy.BEST_EFFORT, durability=durability
        )
    graph = ["plant", "twin", "detector", "adaptor", "recorder"]
    shared = {"graph": graph}
    stranger.start(RecorderNode, bag=str(tmp_path / "bag"), **shared)
    stranger.start(DetectorNode, **shared)
    stranger.start(PredictorNode, **PHYSICS, **shared)
    stranger.start(PlantNode, experiments=3, seed=1, **shared)
    # The adaptor comes last: the first model is sent when it does.
    from ldt_ros.interfaces import message_type

    for topic in (*TOPICS, "/diagnostics"):
        stranger.node.create_subscription(
            message_type(topic),
            topic,
            lambda message, topic=topic: stranger.heard[topic].append(message),
            profile or _declared(topic),
        )
    stranger.start(AdaptorNode, **PHYSICS, **shared)
    stranger.until(lambda: len(stranger.heard["adaptation"]) == 3)
    for topic in set(TOPICS) - {"model", "adaptation"}:
        stranger.until(lambda t=topic: len(stranger.heard[t]) == 3, f"3 messages on {topic}")
    assert stranger.heard["/diagnostics"]
    if durability is None:
        assert len(stranger.heard["model"]) == 1


def _declared(topic: str) -> QoSProfile:
    from ldt_ros.interfaces import qos

    return qos(topic)


# ---- the recorder

LIMIT = 200_000  # bytes; the disk is full then


def recorder(tmp_path: Path, *arguments: str, before=None) -> subprocess.Popen[str]:
    """A recorder in a process of its own."""
    ros = ["--ros-args", "-p", f"bag:={tmp_path / 'bag'}", *arguments]
    return subprocess.Popen(
        [sys.executable, "-m", "ldt_ros.process", "--node", "recorder", *ros],
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        preexec_fn=before,
    )


def noise(number: int, length: int = LENGTH):
    """An experiment that does not compress."""
    random = np.random.default_rng(number)
    base = experiment(number, length=length)
    return type(base)(number, base.start, PERIOD, base.voltage, random.normal(size=length))


def test_a_burst_right_before_the_end_is_recorded_whole(stranger, tmp_path):
    """The recorder drains what is under way when it is told to stop."""
    process = recorder(tmp_path)
    publisher = stranger.publisher("experiment")
    process.send_signal(signal.SIGSTOP)  # whatever comes now lies in wait when it goes on
    for number in range(1, 81):
        publisher.publish(to_message(noise(number, 200)))
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGCONT)
    # Whoever sends stays until the recorder has ended, as in the graph.
    stranger.until(lambda: process.poll() is not None, "end of the recorder")
    assert (process.returncode, process.communicate()[0]) == (0, "")
    bag = read_bag(tmp_path / "bag")
    assert bag.damage is None
    assert [e.number for e in bag.experiments()] == list(range(1, 81))


def test_a_full_disk_is_counted_and_what_was_written_stays(stranger, tmp_path):
    """One line in the log, a count in /diagnostics, exit code 0: the twin does not depend on it."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT, LIMIT))

    process = recorder(tmp_path, before=limit)
    stranger.listen("/diagnostics")
    publisher = stranger.publisher("experiment")
    numbers = iter(range(1, 10_000))

    def full() -> dict[str, str]:
        publisher.publish(to_message(noise(next(numbers), 2000)))
        stranger.spin(0.02)
        told = stranger.health("recorder")
        return told if "rejected experiment: LdtError" in told else {}

    told = stranger.until(full, "rejections by the recorder")
    assert told["level"] == 1
    assert "recording stopped after" in told["last rejection"]
    process.send_signal(signal.SIGINT)
    stranger.until(lambda: process.poll() is not None, "end of the recorder")
    output = process.communicate()[0]
    assert process.returncode == 0, output
    assert output.count("rejected a message on experiment") == 1, output
    assert "Traceback" not in output
    kept = [e.number for e in read_bag(tmp_path / "bag").experiments()]
    assert kept == list(range(1, len(kept) + 1))
    assert kept


# ---- pairing

SIDES = st.lists(st.tuples(st.booleans(), st.integers(1, 12)), max_size=60)


@given(SIDES)
def test_pairing_brings_the_first_of_each_side_together_once(arrivals):
    """In any order of arrival; nothing is lost but what is counted, as long as all fit."""
    met: list[tuple[str, str]] = []
    pairing: Pairing[str, str] = Pairing(lambda left, right: met.append((left, right)))
    waiting: dict[tuple[bool, int], str] = {}
    expected, dropped = [], 0
    for index, (is_left, number) in enumerate(arrivals):
        item = f"{number} at {index}"
        (pairing.left if is_left else pairing.right)(number, item)
        other = waiting.pop((not is_left, number), None)
        if other is not None:
            expected.append((item, other) if is_left else (other, item))
        elif (is_left, number) in waiting:
            dropped += 1
        else:
            waiting[is_left, number] = item
    assert met == expected
    assert pairing.dropped == dropped


@given(SIDES, st.integers(1, 5))
def test_pairing_is_bounded_and_counts_what_it_drops(arrivals, capacity):
    """However many never find their other half; every half met, waits, or was counted."""
    met: list[int] = []
    pairing: Pairing[int, int] = Pairing(lambda left, right: met.extend((left, right)), capacity)
    for is_left, number in arrivals:
        (pairing.left if is_left else pairing.right)(number, number)
        assert len(pairing) <= 2 * capacity
    assert len(met) + len(pairing) + pairing.dropped == len(arrivals)
