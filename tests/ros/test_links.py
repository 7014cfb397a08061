"""Experiments that do not come, publishers that no longer live or do not fit: told, and counted."""

from __future__ import annotations

import os
import signal
import sys

import pytest

rclpy = pytest.importorskip("rclpy")

from rclpy.qos import QoSProfile, ReliabilityPolicy  # noqa: E402
from std_msgs.msg import Float64MultiArray  # noqa: E402
from stranger import adaptation, experiment, log_of  # noqa: E402

from ldt_core.twin.stage import WINDOW  # noqa: E402
from ldt_ros.nodes.detector_node import DetectorNode  # noqa: E402
from ldt_ros.nodes.interfaces import qos, to_message  # noqa: E402
from ldt_ros.nodes.twin_node import Arrivals, TwinNode  # noqa: E402

PHYSICS = {"model": "physics"}
OK, WARN = 0, 1


def told(stranger, role: str, words: str) -> dict[str, str]:
    """What a node says of itself once its message has these words."""
    return stranger.until(lambda: words in (h := stranger.health(role)).get("message", "") and h)


# ---- experiments that are expected


def test_an_experiment_is_overdue_once_until_one_comes():
    """From the beginning on; each time that it is, it is counted once."""
    now = [0.0]
    arrivals = Arrivals(5.0, lambda: now[0])
    for at, newly in ((5.0, False), (5.5, True), (9.0, False)):
        now[0] = at
        assert arrivals.newly_overdue() is newly
    assert arrivals.complaint() == "no experiment for 9 s, one is due every 5 s"
    arrivals.heard()
    assert arrivals.complaint() == ""
    now[0] = 15.0
    assert arrivals.newly_overdue()
    assert arrivals.health() == {"missing": 0, "overdue": 2}


def test_without_a_deadline_none_is_overdue():
    """A machine that runs when it is needed is no trouble."""
    now = [0.0]
    arrivals = Arrivals(0.0, lambda: now[0])
    now[0] = 1e9
    assert not arrivals.newly_overdue()


def test_numbers_that_were_left_out_are_missing_until_they_come():
    """Late is not lost; what came before the first is not known."""
    arrivals = Arrivals(0.0)
    for number in (7, 8, 12, 14):
        arrivals.known(number)
    assert arrivals.complaint() == "4 experiments are missing, last 13"
    arrivals.known(13)
    assert arrivals.complaint() == "3 experiments are missing, last 9 to 11"
    for number in (9, 10, 11):
        arrivals.known(number)
    assert (arrivals.complaint(), arrivals.missing) == ("", 0)


def test_a_gap_of_last_week_is_counted_and_no_warning_any_more():
    """What no source keeps does not come: a warning that never goes hides the next one."""
    arrivals = Arrivals(0.0)
    for number in (1, 4, *range(5, 4 + WINDOW)):
        arrivals.known(number)
    assert arrivals.complaint() == "2 experiments are missing, last 2 to 3"
    arrivals.known(4 + WINDOW)
    assert (arrivals.complaint(), arrivals.missing) == ("", 2)


def test_the_twin_tells_of_overdue_and_missing_experiments(stranger):
    """WARN in /diagnostics with the sentence, a line in the log, counts that stay."""
    stranger.start(TwinNode, **PHYSICS, deadline=0.3)
    stranger.listen("/diagnostics", "prediction")
    logged = log_of(stranger)
    assert told(stranger, "twin", "no experiment for")["level"] == WARN
    stranger.send("experiment", experiment(1))
    stranger.send("adaptation", adaptation(1))
    stranger.send("experiment", experiment(4))
    assert "2 experiments are missing, last 2 to 3" in told(stranger, "twin", "missing")["message"]
    stranger.until(lambda: int(stranger.health("twin")["overdue"]) >= 2)
    assert stranger.health("twin")["missing"] == "2"
    assert stranger.numbers("prediction") == [1, 4]
    assert [m for m in logged if m.msg.endswith("one is due every 0.3 s")]


# ---- publishers


def test_a_publisher_that_cannot_be_heard_is_told_of_while_it_is_there(stranger):
    """It offers best effort where every experiment counts."""
    stranger.start(TwinNode, **PHYSICS)
    stranger.listen("/diagnostics")
    told(stranger, "twin", "running")
    best_effort = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    one = stranger.node.create_publisher(Float64MultiArray, "experiment", best_effort)
    words = "a publisher of experiment offers less reliability than is asked for, and is not heard"
    found = told(stranger, "twin", words)
    assert (found["level"], found["not matched, experiment"]) == (WARN, "1")
    stranger.node.destroy_publisher(one)
    assert told(stranger, "twin", "running")["not matched, experiment"] == "1"


def test_a_listener_that_asks_for_too_much_is_counted_where_it_hears_nothing(stranger):
    """By the publisher, who sees it."""
    node = stranger.start(TwinNode, **PHYSICS)
    logged = log_of(stranger)
    greedy = qos("prediction")
    greedy.deadline = rclpy.duration.Duration(seconds=1)
    stranger.listen("prediction", profile=greedy)
    stranger.until(lambda: node.topics.links.counts["not matched, prediction"] == 1)
    stranger.until(lambda: [m for m in logged if "asks for deadline that is not" in m.msg])


def test_a_publisher_that_is_stopped_is_told_of_until_it_goes_on(stranger, programs):
    """A process of the graph; the same for one that was killed or cut off. The log has both."""
    graph = ["twin", "detector"]
    names = ["--ros-args", "-p", "model:=physics", "-p", f"graph:=[{','.join(graph)}]"]
    other = [sys.executable, "-m", "ldt_ros.graph.process", "--node", "twin"]
    process = programs.start([*other, *names], env=dict(os.environ))
    node = stranger.start(DetectorNode, graph=graph)
    stranger.listen("/diagnostics")
    stranger.until(lambda: node.topics.links.alive.get("prediction"), "a sign of life")
    process.send_signal(signal.SIGSTOP)
    found = told(stranger, "detector", "no sign of life of who publishes prediction")
    assert (found["level"], found["times lifeless, prediction"]) == (WARN, "1")
    logged = log_of(stranger)
    process.send_signal(signal.SIGCONT)
    assert told(stranger, "detector", "running")["level"] == OK
    stranger.until(lambda: [m for m in logged if m.msg == "prediction is heard again"])
    assert not node.topics.rejected
    process.terminate()
    stranger.until(lambda: not node.count_publishers("prediction"))
    assert told(stranger, "detector", "its peers have left")["times lifeless, prediction"] == "1"


def test_a_machine_that_promises_nothing_is_heard(stranger):
    """Nodes of the user's, as which the stranger acts, need no lease and keep no past."""
    stranger.start(TwinNode, **PHYSICS, graph=["twin", "detector", "adaptor"])
    stranger.listen("prediction")
    one = stranger.node.create_publisher(Float64MultiArray, "experiment", QoSProfile(depth=5))
    stranger.until(one.get_subscription_count, "the twin as a listener")
    stranger.spin(0.05)
    one.publish(to_message(experiment(1)))
    stranger.until(lambda: stranger.numbers("prediction") == [1])


def test_a_message_is_a_sign_of_life(stranger):
    """The middleware does not always say that somebody who was cut off is there again."""
    node = stranger.start(DetectorNode)
    node.topics.links.alive["experiment"] = False
    assert node.topics.links.complaint() == "no sign of life of who publishes experiment"
    stranger.send("experiment", experiment(1))
    stranger.until(lambda: node.topics.links.complaint() == "")
