"""What a node does with messages that cannot be used: counts, logs once a kind, and goes on."""

from __future__ import annotations

import array
import json
from dataclasses import replace

import numpy as np
import pytest

from ldt_core.base.experiment import Prediction
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.model_json import model_text

rclpy = pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue  # noqa: E402
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String  # noqa: E402
from stranger import (  # noqa: E402
    LENGTH,
    PERIOD,
    Stranger,
    adaptation,
    answer,
    experiment,
    log_of,
    prediction,
    written,
)

from ldt_ros.nodes.adaptor_node import AdaptorNode  # noqa: E402
from ldt_ros.nodes.detector_node import DetectorNode  # noqa: E402
from ldt_ros.nodes.experiment_source import PlayerNode  # noqa: E402
from ldt_ros.nodes.interfaces import to_message  # noqa: E402
from ldt_ros.nodes.twin_node import TwinNode  # noqa: E402

PHYSICS = {"model": "physics"}
WRONG_NUMBERS = {  # place in data → values that cannot be
    0: [0.0, 1.5, -1.0, np.nan, np.inf],  # experiment number
    1: [np.nan],  # start
    2: [0.0, -0.01, np.inf],  # sample period
    5: [np.nan, np.inf, -np.inf],  # a sample
}


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
        "unbalance beyond floating point": variant(parameters={"machine": {**machine, "e": 1e300}}),
        "a torque constant that overflows": variant(
            parameters={"machine": {**machine, "K_t": 1e300}}
        ),
        "no torque constant": variant(parameters={"machine": {**machine, "K_t": 0.0}}),
        "no inertia": variant(parameters={"machine": {**machine, "J": 0.0}}),
        "another machine's parameters": variant(parameters={"machine": {"k": 1.0, "tau": 2.0}}),
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
    rejected = node.topics.rejected
    for count, (name, message) in enumerate(messages.items(), start=1):
        stranger.send(topic, message)
        stranger.until(lambda c=count: rejected.total() >= c, f"rejection of: {name}")
        assert rejected.total() == count, name
    told = stranger.until(lambda: _told(stranger, node, len(messages)), "count in /diagnostics")
    assert told["level"] == 1  # WARN
    assert len(told["last rejection"]) < 500
    kinds = [key for key in told if key.startswith("rejected ")]
    assert all(key.startswith(f"rejected {topic}: ") for key in kinds)
    lines = lambda: len([m for m in logged if m.name.endswith(node.role)])  # noqa: E731
    stranger.until(lambda: lines() >= len(kinds), "lines in the log")
    stranger.spin(0.2)
    assert lines() == len(kinds)


def _told(stranger: Stranger, node, count: int) -> dict[str, str]:
    told = stranger.health(node.role)
    rejected = sum(int(v) for k, v in told.items() if k.startswith("rejected "))
    return told if rejected == count else {}


# ---- bad messages


@pytest.mark.parametrize("kind", [TwinNode, DetectorNode, AdaptorNode])
def test_what_is_no_experiment_is_counted_logged_once_a_kind_and_the_node_goes_on(kind, stranger):
    """Layout, labels, sizes, strides, offset, head, samples; then a good one is taken."""
    parameters = {} if kind is DetectorNode else PHYSICS
    node = stranger.start(kind, **parameters)
    good = to_message(experiment(1))
    every_one_is_rejected(stranger, node, "experiment", bad_arrays(good, "voltage,torque"))
    before = node.topics.counts["experiment"]
    stranger.send("experiment", good)
    stranger.until(lambda: node.topics.counts["experiment"] > before)
    assert sum(node.topics.rejected.values()) == before
    if kind is TwinNode:
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
    assert sum(node.topics.rejected.values()) == len(bad) + 1


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
    node = stranger.start(TwinNode, **PHYSICS)
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
    node = stranger.start(TwinNode, **PHYSICS)
    every_one_is_rejected(stranger, node, "model", bad_models())
    stranger.listen("prediction")
    stranger.send("experiment", experiment(1))
    stranger.until(lambda: stranger.heard["prediction"])
    assert stranger.heard["prediction"][0].model_version == 0


def test_experiments_that_cannot_be_are_refused_by_number(stranger, monkeypatch):
    """Voltage outside the limits, another of the same number, a lower one: told in /diagnostics.

    At once: the next report is an hour off.
    """
    monkeypatch.setattr("ldt_ros.nodes.node.HEALTH_PERIOD", 3600.0)
    node = stranger.start(TwinNode, **PHYSICS)
    stranger.listen("prediction", "/diagnostics")
    stranger.send("experiment", experiment(3))
    stranger.until(lambda: stranger.numbers("prediction") == [3])
    stranger.send("adaptation", adaptation(3))
    another = replace(experiment(3), start=1.0)
    for bad in (another, experiment(2), experiment(4, voltage=30.0)):
        stranger.send("experiment", bad)
        number = str(bad.number)
        stranger.until(lambda n=number: stranger.health("twin").get("refused experiment") == n)
    assert node.topics.rejected == {"experiment: ExperimentError": 3}
    assert (
        "-24 to 24 V (`limits` in the file of machine 'rotor')"
        in stranger.health("twin")["last rejection"]
    )
    stranger.send("experiment", experiment(4))
    stranger.until(lambda: stranger.numbers("prediction") == [3, 4])


def test_an_experiment_that_comes_again_is_left_out_and_told_of(stranger):
    """Nothing is wrong with it; nobody predicts, judges or learns from it twice."""
    nodes = [stranger.start(kind, **PHYSICS) for kind in (TwinNode, DetectorNode, AdaptorNode)]
    stranger.listen("prediction", "signal", "adaptation", "/diagnostics")
    for number in (1, 1, 2, 1, 2):
        stranger.send("experiment", experiment(number))
        stranger.until(lambda n=number: n in stranger.numbers("adaptation"))
    stranger.until(lambda: stranger.health("twin").get("repeated") == "3")
    for topic in ("prediction", "signal", "adaptation"):
        assert stranger.numbers(topic) == [1, 2]
        late = {"prediction": prediction(1), "signal": answer(2), "adaptation": adaptation(1)}[
            topic
        ]
        stranger.send(topic, late)
    stranger.send("experiment", experiment(3))
    stranger.until(lambda: stranger.numbers("adaptation")[-1] == 3)
    assert stranger.numbers("signal") == [1, 2, 2, 3]  # the stranger's own among them
    assert not any(node.topics.rejected for node in nodes)


def test_a_second_publisher_is_warned_of(stranger):
    """WARN in /diagnostics that names the topic, and one line in the log; gone, all is well."""
    stranger.start(TwinNode, **PHYSICS)
    stranger.listen("/diagnostics")
    logged = log_of(stranger)
    stranger.publisher("experiment")
    stranger.until(lambda: stranger.health("twin").get("level") == 0)
    second = stranger.publisher("experiment")
    told = stranger.until(lambda: (h := stranger.health("twin")).get("level") == 1 and h)
    assert told["message"] == "more than one publisher of experiment"
    stranger.until(lambda: [m for m in logged if "more than one publisher" in m.msg], "a line")
    stranger.spin(1.2)
    assert len([m for m in logged if "more than one publisher" in m.msg]) == 1
    stranger.node.destroy_publisher(second)
    stranger.until(lambda: stranger.health("twin").get("level") == 0)


def test_two_machines_that_count_alike_are_not_mixed(stranger):
    """The twin predicts the first of a number; nobody judges or learns from what is of the other.

    Each node may have heard the two in another order.
    """
    nodes = [stranger.start(kind, **PHYSICS) for kind in (DetectorNode, AdaptorNode)]
    stranger.listen("signal", "adaptation")
    other = replace(experiment(1), start=5e8)
    stranger.send("experiment", other)
    stranger.until(lambda: all(node.topics.counts["experiment"] for node in nodes))
    stranger.send("prediction", prediction(1))
    stranger.send("signal", to_message(answer(1), experiment(1).end))
    stranger.until(lambda: all(len(node.pairs.pairing) == 2 for node in nodes))
    stranger.send("experiment", experiment(1))
    stranger.until(lambda: stranger.numbers("adaptation") == [1])
    stranger.until(lambda: stranger.numbers("signal") == [1, 1])  # the first is the stranger's own
    assert not any(node.topics.rejected for node in nodes)
    assert all(len(node.pairs.pairing) == 1 for node in nodes)


def test_a_clock_that_jumps_changes_nothing(stranger):
    """Experiments are told apart by their numbers; their times may go back and forth."""
    nodes = [stranger.start(kind, **PHYSICS) for kind in (TwinNode, DetectorNode, AdaptorNode)]
    stranger.listen("prediction", "signal", "adaptation")
    for number, start in enumerate((1e9, 5e8, 2e9, 1.0, 1e9), start=1):
        stranger.send("experiment", replace(experiment(number), start=start))
    stranger.until(lambda: stranger.numbers("adaptation") == [1, 2, 3, 4, 5])
    assert stranger.numbers("prediction") == stranger.numbers("signal") == [1, 2, 3, 4, 5]
    assert not any(node.topics.rejected for node in nodes)


def test_what_a_newer_or_older_version_says_is_taken_if_it_says_what_is_needed(stranger):
    """Keys that nobody knows are left aside; models had no digest once."""
    twin = stranger.start(TwinNode, **PHYSICS)
    stranger.start(AdaptorNode, **PHYSICS)
    stranger.listen("adaptation")
    newer = to_message(answer(1))
    newer.status[0].values.append(KeyValue(key="newer", value="7"))
    stranger.send("experiment", experiment(1))
    stranger.send("signal", newer)
    stranger.until(lambda: stranger.numbers("adaptation") == [1])
    older = json.loads(model_text(twin.predictor.model.record()))
    del older["digest"]
    versions = ({**older, "version": 3}, {**older, "version": 4, "newer": [1]})
    stranger.send("model", *(String(data=json.dumps(text)) for text in versions))
    stranger.until(lambda: twin._models.get(4) is not None)
    assert twin._models.get(3) is not None
    assert not twin.topics.rejected


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


def test_absurd_content_costs_its_experiment_alone(stranger):
    """Largest finite speeds, seconds for milliseconds; the whole graph goes on."""
    nodes = [stranger.start(kind, model="linear") for kind in (TwinNode, DetectorNode, AdaptorNode)]
    stranger.listen("adaptation", "/diagnostics")
    good = {number: experiment(number) for number in (1, 4)}
    bad = [
        replace(experiment(2), speed=np.where(np.arange(LENGTH) % 2, 1e308, -1e308)),
        replace(experiment(3), period=10.0),
    ]
    for one in (good[1], *bad, good[4]):
        stranger.send("experiment", one)
        number = one.number
        if one in good.values():
            stranger.until(lambda n=number: n in stranger.numbers("adaptation"))
        else:
            stranger.until(
                lambda n=number: stranger.health("twin").get("refused experiment") == str(n)
            )
    assert stranger.numbers("adaptation") == [1, 4]
    assert nodes[0].health()["missing"] == 0  # they came
    assert nodes[0].topics.rejected == {"experiment: ExperimentError": 2}
    assert not any(node.topics.rejected or node.failure for node in nodes[1:])


@pytest.mark.parametrize("error", [FloatingPointError, BaseException])
def test_whatever_a_node_raises_refuses_the_message_and_ends_nothing(error, stranger, monkeypatch):
    """In a callback and on a worker's thread; counted by kind, with the reason."""
    node = stranger.start(DetectorNode)
    stranger.listen("signal", "/diagnostics")
    step = node.detector.step

    def fail(experiment, prediction):
        if experiment.number == 1:
            raise error("somewhere")
        return step(experiment, prediction)

    monkeypatch.setattr(node.detector, "step", fail)
    for number in (1, 2):
        stranger.send("experiment", experiment(number))
        stranger.send("prediction", prediction(number))
    stranger.until(lambda: stranger.numbers("signal") == [2])
    assert sum(node.topics.rejected.values()) == 1
    assert node.topics.last_rejection.endswith(f"{error.__name__}: somewhere")
    node.worker.deal(experiment(3), lambda: 1 / 0, long=True)
    stranger.until(lambda: not node.worker.busy)
    assert node.failure is None
    assert node.topics.last_rejection == "prediction: ZeroDivisionError: division by zero"


@pytest.mark.parametrize("error", [ValueError, BaseException])
def test_a_source_that_fails_ends_its_node_with_the_reason(error, stranger, tmp_path):
    """As by an effect of the user's own; the run ended with 2 of 6 experiments and exit code 0."""

    def fail():
        raise error("somewhere")

    stranger.listen("experiment")
    node = stranger.start(PlayerNode, play=written(tmp_path / "bag", 1, 2))
    node.source.fetch = fail
    stranger.until(lambda: node.failure)
    assert isinstance(node.failure, Exception)
    assert "somewhere" in str(node.failure)
    assert not node.topics.rejected


def test_a_counter_that_begins_anew_is_followed_by_the_whole_graph(stranger):
    """One experiment is refused, or three where the clock is behind; all others are answered.

    A number out of nowhere costs itself alone. What was refused takes no later one's place.
    """
    nodes = [stranger.start(kind, **PHYSICS) for kind in (TwinNode, DetectorNode, AdaptorNode)]
    stranger.listen("adaptation", "/diagnostics")
    sent = [(n, 100 * turn) for turn, n in enumerate((1, 2, 2**53 - 1, 3, 1, 2, 3))]
    sent += [(n, 100 * n - 5000) for n in (1, 2, 3, 4)] + [(n, 100 * n + 5000) for n in (1, 2, 3)]
    answered = []
    for turn, (number, start) in enumerate(sent):
        stranger.send("experiment", replace(experiment(number), start=1e9 + start))
        if turn in (2, 4, 7, 8, 9, 11):
            stranger.until(lambda n=str(number): stranger.health("twin")["refused experiment"] == n)
        else:
            answered.append(number)
            stranger.until(lambda: stranger.numbers("adaptation") == answered)
    assert answered == [1, 2, 3, 2, 3, 4, 2, 3]
    assert not any(node.topics.rejected for node in nodes[1:])
    assert stranger.health("twin")["missing"] == "0"
