"""Each node alone, over real DDS: order, waiting, time-outs, and who may listen."""

from __future__ import annotations

import gc
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from ldt_core.base.errors import RecordingError
from ldt_core.base.experiment import Action, Level, ModelRecord
from ldt_core.base.settings import resolve
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.writer import BagWriter
from ldt_core.restart.recorded_run import RecordedRun
from ldt_core.runs.offline import run
from ldt_core.twin.detector_stage import build_detector_stage

rclpy = pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402
from std_msgs.msg import String  # noqa: E402
from stranger import TOPICS, Stranger, adaptation, answer, experiment, log_of, written  # noqa: E402

from ldt_ros.nodes import experiment_source  # noqa: E402
from ldt_ros.nodes.adaptor_node import AdaptorNode  # noqa: E402
from ldt_ros.nodes.advisor_node import AdvisorNode  # noqa: E402
from ldt_ros.nodes.detector_node import DetectorNode  # noqa: E402
from ldt_ros.nodes.experiment_source import PlantNode, PlayerNode  # noqa: E402
from ldt_ros.nodes.interfaces import to_message  # noqa: E402
from ldt_ros.nodes.recorder_node import RecorderNode  # noqa: E402
from ldt_ros.nodes.twin_node import TwinNode  # noqa: E402

PHYSICS = {"model": "physics"}


# ---- the twin's order


def test_the_twin_predicts_after_the_adaptation_of_the_one_before(stranger):
    """However early the experiments come."""
    stranger.start(TwinNode, **PHYSICS)
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
    stranger.start(TwinNode, **PHYSICS)
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
    stranger.start(TwinNode, **PHYSICS)
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
    stranger.start(TwinNode, **PHYSICS, adaptation_timeout=0.3)
    stranger.listen("prediction", "/diagnostics")
    logged = log_of(stranger)
    stranger.send("experiment", experiment(1), experiment(2))
    began = time.monotonic()
    stranger.until(lambda: stranger.numbers("prediction") == [1, 2])
    assert time.monotonic() - began > 0.25
    stranger.until(lambda: stranger.health("twin").get("adaptation time-outs") == "1")
    told = stranger.health("twin")
    words = "no adaptation of 1 experiment within 0.3 s: look at the adaptor"
    assert (told["level"], told["message"]) == (1, words)
    lines = [m.msg for m in logged if "no adaptation of experiment 1 within 0.3 s" in m.msg]
    assert len(lines) == 1
    assert "experiment 2 is predicted by model 0" in lines[0]


def test_a_machine_that_is_faster_than_the_queue_does_not_outrun_the_time_out(
    stranger, monkeypatch
):
    """Its turn passes from an experiment that was dropped to the next."""
    monkeypatch.setattr("ldt_ros.nodes.twin_node.QUEUE", 2)
    stranger.start(TwinNode, **PHYSICS, adaptation_timeout=1.0)
    stranger.listen("prediction", "/diagnostics")
    for number in range(1, 41):  # none waits for a second in the queue
        stranger.send("experiment", experiment(number))
        stranger.spin(0.1)
        if len(stranger.numbers("prediction")) > 1:
            break
    assert len(stranger.numbers("prediction")) > 1
    assert stranger.numbers("prediction")[1] > 3


def test_where_two_in_a_row_are_not_answered_what_others_must_lack_is_dropped(
    stranger, monkeypatch
):
    """After a detector hung, each of those that it never got took the time-out: an hour."""
    monkeypatch.setattr("ldt_ros.nodes.twin_node.WINDOW", 3)
    node = stranger.start(TwinNode, **PHYSICS, adaptation_timeout=0.3)
    stranger.listen("prediction", "/diagnostics")
    stranger.send("experiment", *map(experiment, range(1, 11)))
    stranger.until(lambda: len(stranger.numbers("prediction")) == 3)
    assert stranger.numbers("prediction") == [1, 2, 8]  # the last 3 are 8, 9, 10
    stranger.until(lambda: stranger.health("twin").get("dropped") == "5")
    stranger.send("adaptation", adaptation(8))
    stranger.until(lambda: stranger.numbers("prediction")[-1] == 9)
    assert node.predictor.last == 9


def test_a_twin_that_joins_late_has_the_model_in_force(stranger):
    """The models are latched; the last of them predicts the first experiment that it sees."""
    from ldt_ros.nodes.interfaces import qos

    early = stranger.node.create_publisher(String, "model", qos("model"))
    for version in (1, 2):
        early.publish(to_message(model_record(version)))
    node = stranger.start(TwinNode, **PHYSICS)
    stranger.until(lambda: node.topics.counts["model"] == 2, "latched models")
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


def test_health_is_told_while_the_adaptor_trains_and_order_is_kept(stranger, models, capfd):
    """Training is on a thread of its own; what comes meanwhile waits for it.

    What was learned is in the log: a service's journal is all that its engineer reads.
    """
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
    assert "[adaptor]: experiment 1: version 1" in capfd.readouterr().err


def no_more_threads(self):
    """What the system says where memory or threads have run out."""
    raise RuntimeError("can't start new thread")


def test_a_node_needs_no_further_thread_once_it_runs(stranger, models, monkeypatch):
    """Its first training comes hours later, when there may be none to be had."""
    node = stranger.start(AdaptorNode, model=f"{models}:SlowModel", gate="none")
    type(node.adaptor.model).fit.__globals__["GO_ON"].set()
    stranger.listen("adaptation")
    monkeypatch.setattr(threading.Thread, "start", no_more_threads)
    stranger.send("experiment", experiment(1))
    stranger.send("signal", answer(1, Level.POSITIVE))
    stranger.until(lambda: stranger.heard["adaptation"])
    assert stranger.heard["adaptation"][0].action is Action.ADAPTED
    stranger.until(lambda: not node.worker.busy)


def test_what_the_thread_does_not_take_is_told_and_not_awaited(stranger, models):
    """Were it pending for ever, the node would put all that comes behind it."""
    node = stranger.start(AdaptorNode, model=f"{models}:SlowModel", gate="none")
    stranger.listen("adaptation")
    node.worker.thread.shutdown()
    stranger.send("experiment", experiment(1), experiment(2))
    stranger.send("signal", answer(1, Level.POSITIVE), answer(2))
    stranger.until(lambda: stranger.numbers("adaptation") == [2])
    assert node.topics.rejected.total() == 1
    assert not node.worker.busy


def test_a_fault_of_a_users_model_costs_its_experiment_and_is_told(stranger, models):
    """The adaptor answers and goes on: waiting for an answer that never comes would hide it."""
    node = stranger.start(AdaptorNode, model=f"{models}:BrokenModel", gate="none")
    stranger.listen("adaptation")
    stranger.send("experiment", experiment(1))
    stranger.send("signal", answer(1, Level.POSITIVE))
    stranger.until(lambda: stranger.numbers("adaptation") == [1])
    assert node.failure is None
    assert "a fault of the user's model" in stranger.heard["adaptation"][0].reason


def test_a_late_joiner_gets_the_model_in_force(stranger):
    """Reliable and transient-local, as the contract says."""
    stranger.start(AdaptorNode, **PHYSICS)
    stranger.spin(0.3)
    stranger.listen("model")
    stranger.until(lambda: [m.version for m in stranger.heard["model"]] == [0])
    assert stranger.heard["model"][0].kind == "physics"


def test_who_joins_late_gets_what_the_others_of_its_graph_have_sent(stranger):
    """On a busy computer nodes meet one by one; a prediction sent before was lost for good."""
    both = {"graph": ["twin", "detector"]}
    stranger.start(TwinNode, **PHYSICS, **both)
    stranger.listen("prediction")
    stranger.send("experiment", experiment(1))
    stranger.until(lambda: stranger.numbers("prediction") == [1])
    stranger.start(DetectorNode, **both)
    stranger.listen("signal")
    del stranger.publishers["experiment"]  # the next one meets the detector, too
    stranger.send("experiment", experiment(1))
    stranger.until(lambda: stranger.numbers("signal") == [1])


def test_a_node_says_which_of_its_graph_it_waits_for(stranger, monkeypatch):
    """It was "waiting for its peers"; of the two that listen to a prediction, one is there."""
    monkeypatch.setattr("ldt_ros.nodes.node.MEETING_TIME", 0.5)
    graph = {"graph": ["twin", "detector", "recorder"]}
    stranger.start(TwinNode, **PHYSICS, **graph)
    stranger.start(DetectorNode, **graph)
    stranger.listen("/diagnostics")
    words = "waiting for its peers: recorder"
    stranger.until(lambda: stranger.health("twin").get("message") == words, words)


def test_one_without_the_other_waits_and_the_first_of_a_number_counts(stranger):
    """Signals before their experiments; a second experiment of a number is dropped and counted."""
    stranger.start(AdaptorNode, **PHYSICS)
    stranger.listen("adaptation", "/diagnostics")
    stranger.send("signal", answer(2), answer(1))
    stranger.send("experiment", experiment(1), experiment(2), experiment(3), experiment(3))
    stranger.until(lambda: stranger.numbers("adaptation") == [1, 2])
    stranger.until(lambda: stranger.health("adaptor").get("unpaired") == "1")


def test_a_node_that_is_started_again_waits_for_its_recording_to_be_mended(
    stranger, tmp_path, monkeypatch
):
    """The recorder may be at it at the same moment; no step is taken twice."""
    folder, tries = tmp_path / "run", []
    settings = resolve({"model": "linear", "experiments": 6, "start_time": 1e9})
    plant = Plant.from_settings(load_machine("rotor"), settings)
    run(plant.machine, settings, map(plant.experiment, range(1, 7)), folder)

    steps = RecordedRun.steps

    def half(*arguments):
        tries.append(arguments)
        for step in steps(*arguments):
            yield step
            if len(tries) < 3 and step.number == 2 * len(tries):
                raise RecordingError(folder, "a recording", "half of one")

    monkeypatch.setattr(RecordedRun, "steps", half)
    monkeypatch.setattr("ldt_ros.nodes.own_recording.MENDING", 0.01)
    node = stranger.start(DetectorNode, resume=str(folder))
    assert (len(tries), node.worker.finished_with) == (3, 6)
    expected = build_detector_stage(resolve({}))
    for step in steps(RecordedRun(folder, "/", node.machine)):
        expected.recall(step)
    assert node.detector.detector.state() == expected.detector.state()


def test_an_adaptor_slower_than_the_machine_keeps_what_waits_bounded(stranger):
    """What comes beyond is left out, counted and told of; the rest is dealt with in order."""
    node = stranger.start(AdaptorNode, **PHYSICS)
    stranger.listen("adaptation", "/diagnostics")
    gate, step = threading.Event(), node.adaptor.step
    node.adaptor.step = lambda *pair: gate.wait(30) and step(*pair)
    waiting = node.worker.waiting
    for number in range(1, waiting + 21):
        stranger.send("experiment", experiment(number, length=2))
        stranger.send("signal", answer(number, Level.POSITIVE))
        stranger.spin(0.01)
    told = stranger.until(lambda: stranger.health("adaptor").get("dropped") not in (None, "0"))
    assert told
    stranger.until(lambda: node.worker.left_out == 19)  # one is at work, and so many wait
    gate.set()
    stranger.until(lambda: len(stranger.heard["adaptation"]) == waiting + 1)
    assert stranger.numbers("adaptation") == list(range(1, waiting + 2))


# ---- plant and player


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


@pytest.mark.parametrize("late", [False, True])
def test_a_player_without_a_graph_says_for_what_it_waits(late, stranger, tmp_path, monkeypatch):
    """It was silent for 60 s after the first experiment, and after the last."""
    monkeypatch.setattr(experiment_source, "MEETING", 0.3)
    logged = log_of(stranger)
    node = stranger.start(PlayerNode, play=written(tmp_path / "bag", 1, 2))
    stranger.until(lambda: node.source._sent)
    if late:
        stranger.start(AdaptorNode, **PHYSICS)
    line = stranger.until(lambda: [m.msg for m in logged if "waits 60 s" in m.msg])
    assert "waits 60 s (adaptation_timeout) for the adaptation of experiment 1" in line[0]
    assert ("before anybody listened" if late else "nobody publishes adaptations") in line[0]


def test_a_source_says_for_whom_of_its_graph_it_waits(stranger, tmp_path, monkeypatch):
    """In its log: who reads `/diagnostics` is perhaps among the missing."""
    monkeypatch.setattr(experiment_source, "STARTING", 0.2)
    logged = log_of(stranger)
    graph = ["twin", "detector", "player"]
    stranger.start(PlayerNode, play=written(tmp_path / "bag", 1), graph=graph)
    line = stranger.until(lambda: [m.msg for m in logged if "waits for" in m.msg])
    assert line == ["waits for detector, twin, as its graph names them"]


def test_a_source_waits_for_the_nodes_of_its_graph(stranger, tmp_path):
    """Nothing is sent before all that the graph names have told that they are ready."""
    graph = ["twin", "detector", "player"]
    play = written(tmp_path / "bag", 1)
    stranger.listen("experiment")
    stranger.start(PlayerNode, play=play, graph=graph)
    stranger.start(TwinNode, **PHYSICS, graph=graph)
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
    stranger.start(TwinNode, **PHYSICS, **graph)
    player = stranger.start(PlayerNode, play=play, **graph)
    began = time.monotonic()
    stranger.until(lambda: player.finished)
    assert time.monotonic() - began < 10
    assert stranger.numbers("adaptation") == [1, 3]


def test_a_source_that_is_stopped_does_not_say_that_it_has_finished(stranger, tmp_path):
    """It says that it was stopped, and sends nothing more; one that had finished has finished."""
    stranger.listen("experiment", "/diagnostics")
    node = stranger.start(PlayerNode, play=written(tmp_path / "bag", 1, 2, 3))
    stranger.until(lambda: stranger.numbers("experiment") == [1])
    node.halt()
    told = stranger.until(lambda: (h := stranger.health("player")).get("stopped") == "true" and h)
    assert told["finished"] == "false"
    stranger.send("adaptation", adaptation(1))
    stranger.until(lambda: node.quiet)
    assert stranger.numbers("experiment") == [1]
    node.finished, node.stopped = True, False
    node.halt()
    assert not node.stopped


def test_the_player_sends_the_chosen_experiments_alone(stranger, tmp_path):
    """By their numbers, to the last one."""
    stranger.listen("experiment", "/diagnostics")
    stranger.start(PlayerNode, play=written(tmp_path / "bag", 1, 2, 3, 4), only="2,4-")
    stranger.until(lambda: stranger.numbers("experiment") == [2])
    stranger.send("adaptation", adaptation(2))
    stranger.until(lambda: stranger.numbers("experiment") == [2, 4])
    stranger.send("adaptation", adaptation(4))
    stranger.until(lambda: stranger.health("player").get("finished") == "true")


@pytest.mark.parametrize("name", ["rotor", "press"])
def test_the_player_says_where_a_recording_is_of_another_machine(stranger, tmp_path, name):
    """In the graph's log, and plays it."""
    lines = log_of(stranger)
    with BagWriter(tmp_path / "bag", machine=name) as writer:
        writer.write("experiment", experiment(1), experiment(1).end)
    stranger.listen("experiment")
    stranger.start(PlayerNode, play=str(tmp_path / "bag"))
    stranger.until(lambda: stranger.heard["experiment"])
    stranger.spin(0.1)
    told = [line.msg for line in lines if "recorded of the machine" in line.msg]
    named = "recorded of the machine 'press', while the machine file is of 'rotor'"
    assert told == ([f"{tmp_path / 'bag'}: {named}"] if name == "press" else [])


def test_a_recording_that_breaks_while_it_is_played_ends_the_player(stranger, tmp_path):
    """It is a fault of the recording, not of the adaptation that asked for the next experiment."""
    stranger.listen("experiment")
    node = stranger.start(PlayerNode, play=written(tmp_path / "bag", 1, 2, 3))
    stranger.until(lambda: stranger.numbers("experiment") == [1])

    def broken():
        from ldt_core.base.errors import RecordingError

        raise RecordingError("bag", "an experiment", "rubbish")

    node.source.fetch = broken
    stranger.send("adaptation", adaptation(1))
    stranger.until(lambda: node.failure is not None)
    assert str(node.failure) == "bag: expected an experiment, got rubbish"
    assert not node.topics.rejected


# ---- the launching process


def test_the_launching_process_waits_for_a_twin_as_long_as_something_is_answered(
    monitor, stranger, monkeypatch
):
    """A twin whose queue a flood had filled waited a minute for each of 200: three hours."""
    node, _ = monitor
    waiting = DiagnosticStatus(name="twin", values=[KeyValue(key="waiting", value="198")])
    stranger.send("/diagnostics", DiagnosticArray(status=[waiting]))
    stranger.until(lambda: node.busy)
    node.longest_wait = 0.0
    monkeypatch.setattr("ldt_ros.graph.monitor.WAITED", 0.5)
    stranger.until(lambda: not node.busy)
    stranger.send("adaptation", adaptation(1))
    stranger.until(lambda: node.busy, "hope after an answer")
    stranger.until(lambda: not node.busy)


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
    stranger.send("adaptation", adaptation(2))
    stranger.until(lambda: not node.idle, "a step that is not told")
    stranger.send("signal", answer(2))
    stranger.until(lambda: node.idle)
    stranger.send("/diagnostics", health("player", experiment="2", finished="false"))
    stranger.until(lambda: not node.idle, "a source that goes on")
    stopped = health("player", experiment="2", finished="false", stopped="true")
    stranger.send("/diagnostics", stopped)
    stranger.until(lambda: node.idle)
    assert not node.source_finished


def test_a_step_is_told_once_whichever_message_came_first(monitor, stranger):
    """Two nodes send them: nothing says whose comes first, and a lost packet is sent again."""
    node, steps = monitor
    for number in (1, 3):
        stranger.send("signal", answer(number))
        stranger.until(lambda n=number: node.last_signal == n)
        stranger.send("adaptation", adaptation(number))
        stranger.until(lambda n=number: node.last_step == n)
        stranger.send("adaptation", adaptation(number + 1))
        stranger.until(lambda n=number: node.last_step == n + 1)
        stranger.send("signal", answer(number + 1))
        stranger.until(lambda n=number: node.last_signal == n + 1)
    stranger.send("adaptation", adaptation(4))
    stranger.spin(0.1)
    assert [(s.experiment, a.experiment) for s, a in steps] == [(n, n) for n in (1, 2, 3, 4)]


# ---- everyone may listen


@pytest.mark.parametrize("durability", [DurabilityPolicy.VOLATILE, None])
def test_stock_tools_can_listen_to_every_topic(durability, stranger, tmp_path, short_rotor):
    """Best effort and volatile as `ros2 topic echo` may be, or as the topics are declared."""
    profile = None
    if durability is not None:
        profile = QoSProfile(
            depth=50, reliability=ReliabilityPolicy.BEST_EFFORT, durability=durability
        )
    graph = ["plant", "twin", "detector", "adaptor", "advisor", "recorder"]
    shared = {"graph": graph, "machine": short_rotor}
    stranger.start(RecorderNode, bag=str(tmp_path / "bag"), **shared)
    stranger.start(DetectorNode, **shared)
    stranger.start(AdvisorNode, advice_every=1, **shared)
    stranger.start(TwinNode, **PHYSICS, **shared)
    streaming = {"stream": "beside", "measure_current": True}
    stranger.start(PlantNode, experiments=3, seed=1, **streaming, **shared)
    # The adaptor comes last: the first model is sent when it does.
    from ldt_ros.nodes.interfaces import message_type

    for topic in (*TOPICS, "/diagnostics"):
        stranger.node.create_subscription(
            message_type(topic),
            topic,
            lambda message, topic=topic: stranger.heard[topic].append(message),
            profile or _declared(topic),
        )
    stranger.start(AdaptorNode, **PHYSICS, **shared)
    stranger.until(lambda: len(stranger.heard["adaptation"]) == 3)
    samples = {"joint_states", "voltage", "current"}
    for topic in samples:  # a listener without reliability loses many
        stranger.until(lambda t=topic: stranger.heard[t], f"samples on {topic}")
    for topic in set(TOPICS) - {"model", "adaptation", "diagnosis"} - samples:
        stranger.until(lambda t=topic: len(stranger.heard[t]) == 3, f"3 messages on {topic}")
    assert stranger.heard["/diagnostics"]
    if durability is None:
        assert len(stranger.heard["model"]) == 1


def _declared(topic: str) -> QoSProfile:
    from ldt_ros.nodes.interfaces import qos

    return qos(topic)


def test_a_node_that_has_ended_takes_no_other_s_log_with_it(domain, request):
    """The next of its name is heard, whenever the garbage of the first is collected."""
    request.addfinalizer(gc.enable)
    for _ in range(2):
        one = Stranger()
        node = one.start(AdaptorNode, **PHYSICS)
        gc.collect()
        lines = log_of(one)
        node.get_logger().error("hello")
        one.until(lambda: lines, "a line in the log")  # noqa: B023
        gc.disable()
        one.close()
        del one, node
