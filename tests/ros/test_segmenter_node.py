"""A machine that streams samples: plant and player as one, and the node that cuts them."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

from ldt_core.base.experiment import Experiment
from ldt_core.base.settings import resolve
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.runs.offline import run

rclpy = pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Float64, String  # noqa: E402
from stranger import adaptation, log_of, written  # noqa: E402
from stranger import experiment as numbered  # noqa: E402

from ldt_core.base.errors import OptionError  # noqa: E402
from ldt_core.recording.node_status import WRONG_STREAM  # noqa: E402
from ldt_ros.graph.machine_run import machine_runs, write_parameters  # noqa: E402
from ldt_ros.nodes import segmenter_node  # noqa: E402
from ldt_ros.nodes.experiment_source import PlantNode, PlayerNode, exact_stamp  # noqa: E402
from ldt_ros.nodes.segmenter_node import Feed, SegmenterNode  # noqa: E402

PERIOD, SIZE = 0.02, 25  # s, samples: half a second of a machine in real time
START = 1.7e9 + 0.123456789  # s
SHORT = {"length": SIZE * PERIOD, "sample_period": PERIOD}


def plain(experiments: list[Experiment]) -> list[tuple]:
    """For comparison bit by bit."""
    return [
        (e.number, e.start, e.period, e.voltage.tobytes(), e.speed.tobytes(), e.current is None)
        for e in experiments
    ]


def test_a_stream_has_no_end_unless_somebody_says_so(stranger, tmp_path):
    """A service ended after 200 experiments; a run that wants 200 says so to its node."""
    node = stranger.start(SegmenterNode, **SHORT)
    node._sent = 199
    node._publish([numbered(200), numbered(201)])
    assert (node._sent, node.finished) == (201, False)
    (run,) = machine_runs(resolve({"source": "stream", "bag": str(tmp_path / "run")}))
    told = yaml.safe_load(Path(write_parameters(run, tmp_path)).read_text())
    assert told["/**"]["ros__parameters"]["experiments"] == 200


@pytest.mark.parametrize("rate", ["max", "20"])
def test_what_the_plant_streams_comes_back_as_the_experiments_that_it_was(
    rate, stranger, short_rotor
):
    """Number, start, period and every sample to the last bit; nothing left out."""
    stranger.listen("experiment", "/diagnostics")
    node = stranger.start(SegmenterNode, machine=short_rotor, current_from="current", experiments=3)
    settings = {"experiments": 3, "seed": 5, "start_time": START, "measure_current": True}
    stranger.start(
        PlantNode, machine=short_rotor, stream="only", rate=rate, graph=["segmenter"], **settings
    )
    stranger.until(lambda: node.finished, "three experiments")
    stranger.until(lambda: stranger.numbers("experiment") == [1, 2, 3])
    plant = Plant.from_settings(load_machine(short_rotor), resolve(settings))
    made = [plant.experiment(number) for number in (1, 2, 3)]
    assert plain(stranger.heard["experiment"]) == plain(made)
    for heard, original in zip(stranger.heard["experiment"], made, strict=True):
        assert heard.current.tobytes() == original.current.tobytes()
    told = stranger.until(
        lambda: (h := stranger.health("segmenter")).get("finished") == "true" and h
    )
    assert told["sent"] == "3"
    assert told["speed from"] == "/joint_states (sensor_msgs/msg/JointState)"
    assert not [key for key in told if key.startswith("left out")]


@pytest.mark.parametrize(("had", "heard"), [("0", 4), ("6", 8)])
def test_a_segmenter_that_is_started_again_numbers_on(
    had, heard, stranger, short_rotor, tmp_path, monkeypatch
):
    """After what is recorded, and after what the twin has had of which nothing is recorded yet."""
    recorded = written(tmp_path / "bag", 1, 2, 3)
    stranger.listen("experiment")
    twin = [KeyValue(key="experiment", value=had), KeyValue(key="waiting", value="1")]
    node = stranger.start(SegmenterNode, machine=short_rotor, resume=recorded)
    told = []
    monkeypatch.setattr(node._gate, "_tell", lambda one, do=node._gate._tell: told.append(do(one)))
    stranger.send(
        "/diagnostics", DiagnosticArray(status=[DiagnosticStatus(name="twin", values=twin)])
    )
    stranger.until(lambda: told, "what the twin tells")
    beside = {"stream": "only", "experiments": 1, "graph": ["segmenter"]}
    stranger.start(PlantNode, machine=short_rotor, **beside)
    stranger.until(lambda: stranger.heard["experiment"])
    assert stranger.numbers("experiment") == [heard]


def test_the_graph_learns_from_a_stream_what_it_learns_offline(
    domain, programs, tmp_path, short_rotor
):
    """`ldt up --source stream` beside a machine in a process of its own: bit-equal to `ldt run`."""
    from ldt_ros.up import launch

    common = {"machine": short_rotor, "experiments": 4, "seed": 5, "start_time": START}
    twin = {
        "model": "linear",
        "order": 1,
        "detector": "threshold",
        "threshold": 0.5,
        "gate": "none",
    }
    offline = resolve({**common, **twin})
    machine = load_machine(short_rotor)
    plant = Plant.from_settings(machine, offline)
    run(machine, offline, map(plant.experiment, range(1, 5)), tmp_path / "offline")

    given = [f"{name}:={value}" for name, value in common.items()]
    given += ["stream:=only", "rate:=10", "graph:=[segmenter]"]
    arguments = [part for text in given for part in ("-p", text)]
    process = programs.start(
        [
            sys.executable,
            "-m",
            "ldt_ros.graph.process",
            "--node",
            "plant",
            "--ros-args",
            *arguments,
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    (done,) = launch({**common, **twin, "source": "stream", "bag": str(tmp_path / "live")})
    printed, _ = process.communicate(timeout=60)
    assert process.returncode == 0, printed
    assert done.summary.experiments == 4
    assert not done.summary.notes
    for topic in ("experiment", "prediction", "signal", "adaptation", "model"):
        live, alone = (
            [
                {k: v.tobytes() if isinstance(v, np.ndarray) else v for k, v in vars(r).items()}
                for r in read_bag(tmp_path / folder).records(topic)
            ]
            for folder in ("live", "offline")
        )
        assert live == alone
    assert [a for a in read_bag(tmp_path / "live").records("adaptation") if a.model_version]


def test_samples_can_be_published_beside_the_experiments(stranger, tmp_path):
    """For stock tools: stamps, joint and numbers of each, all before the experiment itself."""
    heard: list = []
    for topic in ("joint_states", "voltage"):
        stranger.node.create_subscription(
            JointState, topic, lambda m, topic=topic: heard.append((topic, m)), 1000
        )
    stranger.listen("experiment")
    stranger.start(PlayerNode, play=written(tmp_path / "bag", 1, 2), stream="beside")
    stranger.until(lambda: stranger.numbers("experiment") == [1])
    stranger.send("adaptation", adaptation(1))
    stranger.until(lambda: stranger.numbers("experiment") == [1, 2])
    stranger.until(lambda: len(heard) == 240)
    for number, experiment in enumerate(stranger.heard["experiment"]):
        for topic, names in (("joint_states", "velocity"), ("voltage", "effort")):
            messages = [m for t, m in heard if t == topic][60 * number : 60 * (number + 1)]
            values = experiment.speed if topic == "joint_states" else experiment.voltage
            assert [getattr(m, names)[0] for m in messages] == values.tolist()
            assert {tuple(m.name) for m in messages} == {("rotor",)}
            stamps = [m.header.stamp.sec + m.header.stamp.nanosec * 1e-9 for m in messages]
            np.testing.assert_allclose(stamps, experiment.start + experiment.time, atol=3e-7)


def test_nothing_is_streamed_unless_asked_for(stranger, tmp_path):
    """The topics do not even appear."""
    stranger.listen("experiment")
    stranger.start(PlayerNode, play=written(tmp_path / "bag", 1))
    stranger.until(lambda: stranger.numbers("experiment") == [1])
    assert stranger.node.count_publishers("joint_states") == 0


class Machine:
    """A foreign machine: topics, message types and a clock of its own.

    Args:
        behind: of its clock [s].
    """

    def __init__(self, stranger, behind: float = 0.0, **options) -> None:
        self.stranger, self.behind = stranger, behind
        self.speed = stranger.node.create_publisher(JointState, "wheel/states", 1000)
        profile = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.voltage = stranger.node.create_publisher(Float64, "motor/command", profile)
        self.set(4.0)
        sources = {"voltage_from": "motor/command", "speed_from": "wheel/states.velocity[1]:rpm"}
        self.node = stranger.start(SegmenterNode, **sources, **SHORT, **options)
        stranger.listen("experiment", "/diagnostics")
        stranger.until(lambda: self.speed.get_subscription_count() > 0)
        stranger.spin(0.2)

    def set(self, volts: float) -> None:
        """A command, latched, which is sent when it changes."""
        self.voltage.publish(Float64(data=volts))

    def run(self, samples: int, count: int = 0) -> None:
        """Real time."""
        for index in range(samples):
            message = JointState(name=["idle", "wheel"], velocity=[np.nan, float(count + index)])
            message.header.stamp = exact_stamp(time.time() - self.behind)
            self.speed.publish(message)
            self.stranger.spin(PERIOD)


def test_a_foreign_machine_with_a_latched_command_and_another_clock(stranger):
    """Command without a stamp, sent when it changes; speed of one joint of two, in rpm."""
    logged = log_of(stranger)
    machine = Machine(stranger, behind=1000.0, lateness=0.1, longest_gap=5.0)
    machine.run(SIZE)
    changed = time.time() - 1000.0
    machine.set(9.0)
    machine.run(2 * SIZE, SIZE)
    # A busy computer takes longer for the samples before, and cuts more experiments out of them.
    experiments = stranger.heard["experiment"]
    stranger.until(lambda: any(9.0 in e.voltage for e in experiments), "the command")
    first = experiments[0]
    assert first.speed[0] == 0.0
    assert first.speed.max() < 3 * SIZE * 2 * np.pi / 60
    assert np.all(np.diff(first.speed) >= 0)
    volts = np.concatenate([e.voltage for e in experiments])
    times = np.concatenate([e.start + e.time for e in experiments])
    assert np.count_nonzero((volts != 4.0) & (volts != 9.0)) <= 1  # set within a period
    # The command comes between two speeds; a busy computer makes these far apart.
    assert abs(times[np.argmax(volts)] - changed) < 0.3
    warned = [m.msg for m in logged if "have no stamp" in m.msg]
    assert len(warned) == 1
    assert "/motor/command have no stamp and count when they come" in warned[0]


def test_messages_that_cannot_be_used_are_counted_and_the_node_goes_on(stranger):
    """A field that is not there, a type without a number: one line in the log each."""
    logged = log_of(stranger)
    publisher = stranger.node.create_publisher(String, "motor/command", 10)
    speed = stranger.node.create_publisher(JointState, "joint_states", 10)
    stranger.start(SegmenterNode, voltage_from="motor/command", **SHORT)
    stranger.listen("/diagnostics")
    stranger.until(lambda: publisher.get_subscription_count() and speed.get_subscription_count())
    for _ in range(3):
        publisher.publish(String(data="full"))
        speed.publish(JointState(name=["a", "b"], velocity=[1.0, 2.0]))
        speed.publish(JointState(name=["a"]))
    told = stranger.until(
        lambda: (
            (h := stranger.health("segmenter")).get("rejected joint_states: RecordingError") == "6"
            and h
        )
    )
    assert told["rejected motor/command: RecordingError"] == "3"
    assert told["level"] == 1
    lines = [m.msg for m in logged if "rejected a message on" in m.msg]
    assert len(lines) == 2, lines
    assert any("motor/command.FIELD" in line for line in lines)
    assert any("2 joints" in line for line in lines)
    assert all(line.count("joint_states: ") + line.count("motor/command: ") == 1 for line in lines)


def test_a_topic_that_nobody_publishes_is_told_beside_those_there_are(stranger, monkeypatch):
    """A name that is misspelt must not be waited for in silence."""
    monkeypatch.setattr(segmenter_node, "MISSING_LOOKS", 5)
    logged = log_of(stranger)
    stranger.node.create_publisher(Float64, "motor/volts", 10)
    stranger.node.create_publisher(String, "motor/name", 10)
    stranger.start(SegmenterNode, voltage_from="motor/volt", speed_from="motor/volts", **SHORT)
    stranger.listen("/diagnostics")
    line = stranger.until(lambda: [m.msg for m in logged if "nobody publishes" in m.msg])
    assert line == [
        "voltage_from: nobody publishes /motor/volt yet; of topics of numbers there are "
        "/motor/volts (std_msgs/msg/Float64)"
    ]
    told = stranger.until(
        lambda: "nobody publishes" in (h := stranger.health("segmenter"))["message"] and h
    )
    assert told["level"] == 1
    assert told[WRONG_STREAM] == told["message"]


def test_a_speed_that_no_longer_comes_is_told_until_it_does(stranger, monkeypatch):
    """A machine that had ended, or hung, left a segmenter that was "running"."""
    monkeypatch.setattr(segmenter_node, "MISSING_LOOKS", 10)
    stranger.listen("/diagnostics")
    stranger.start(SegmenterNode, voltage_from="volts", speed_from="speed", **SHORT)
    made = [stranger.node.create_publisher(Float64, topic, 10) for topic in ("volts", "speed")]
    stranger.until(lambda: all(p.get_subscription_count() for p in made))

    def silent(*publishers):
        for publisher in publishers:
            publisher.publish(Float64(data=1.0))
        words = stranger.health("segmenter").get(WRONG_STREAM, "")
        return words if "nothing has come on /speed for" in words else ""

    stranger.until(silent, "a speed that has not come yet")
    stranger.until(lambda: not silent(*made), "a speed")
    assert "any more" not in stranger.until(lambda: silent(made[0]), "a speed that has ended")
    stranger.node.destroy_publisher(made.pop())
    stranger.until(lambda: "nobody publishes it any more" in silent(), "the publisher's end")
    assert stranger.health("segmenter")["level"] == 1


def test_a_publisher_that_returns_with_another_profile_is_heard(stranger, monkeypatch):
    """Best effort in place of reliable: nothing came any more, and nothing was said.

    Nor was anything said of times that are those of arrival.
    """
    monkeypatch.setattr(segmenter_node, "MISSING_LOOKS", 0)
    stranger.listen("/diagnostics")
    node = stranger.start(SegmenterNode, voltage_from="volts", speed_from="speed", **SHORT)
    for reliability in (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT):
        profile = QoSProfile(depth=10, reliability=reliability)
        made = [stranger.node.create_publisher(Float64, t, profile) for t in ("volts", "speed")]
        came = node.segmenter.rows_in
        stranger.until(lambda made=made: all(p.get_subscription_count() for p in made))

        def sent(made=made, came=came):
            for publisher in made:
                publisher.publish(Float64(data=1.0))
            stranger.spin(PERIOD)
            return node.segmenter.rows_in > came

        stranger.until(sent, f"samples of a publisher that is {reliability.name}")
        for publisher in made:
            stranger.node.destroy_publisher(publisher)
        stranger.until(lambda: not node.count_publishers("speed"), "the publisher's end")
    words = "have no stamp and count when they come: what delays them"
    stranger.until(lambda: words in stranger.health("segmenter").get(WRONG_STREAM, ""), words)


def test_two_publishers_of_one_topic_stop_it_until_one_is_left(stranger):
    """Whose samples they are nobody can tell; it is said and counted."""
    machine = Machine(stranger, longest_gap=5.0)
    machine.run(5)
    rival = stranger.node.create_publisher(JointState, "wheel/states", 10)
    told = stranger.until(
        lambda: "more than one publisher" in (h := stranger.health("segmenter"))["message"] and h
    )
    assert told["level"] == 1
    machine.run(2 * SIZE, 100)
    assert stranger.heard["experiment"] == []
    stranger.node.destroy_publisher(rival)
    stranger.until(lambda: machine.node.count_publishers("wheel/states") == 1)
    stranger.spin(0.3)
    machine.run(SIZE + 8, 1000)
    stranger.until(lambda: stranger.heard["experiment"])
    assert stranger.heard["experiment"][0].speed.min() >= 1000 * 2 * np.pi / 60
    assert stranger.health("segmenter")["left out, more than one publisher of wheel/states"] == "1"


@pytest.mark.parametrize(
    ("text", "topic", "steps"),
    [
        ("voltage", "voltage", ()),
        ("/press/motor:mV", "/press/motor", ()),
        ("motor/command.data", "motor/command", ("data",)),
        ("/joint_states.velocity[2]:rpm", "/joint_states", ("velocity", 2)),
    ],
)
def test_where_samples_come_from_is_written_as_for_an_import(text, topic, steps):
    """And may be relative, or leave out the field."""
    feed = Feed("speed" if "rpm" in text else "voltage", text)
    assert (feed.topic, feed.steps) == (topic, steps)
    assert feed.factor == {"/press/motor:mV": 1e-3}.get(
        text, 2 * np.pi / 60 if "rpm" in text else 1
    )


@pytest.mark.parametrize("text", ["", "/", "a b", "x[0]", "x.", "x.y[", "voltage:rpm"])
def test_what_is_no_source_is_refused(text):
    """The sentence names the parameter."""
    with pytest.raises(OptionError, match="voltage_from"):
        Feed("voltage", text)


def test_a_speed_from_nowhere_is_refused(stranger):
    """A segmenter waited for ever."""
    with pytest.raises(OptionError, match="speed_from"):
        SegmenterNode(
            context=stranger.context, parameter_overrides=[rclpy.Parameter("speed_from", value="")]
        )
