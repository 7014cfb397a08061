"""The live page's ear: machines are found, strangers' words do no harm, a real graph is shown."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from typing import Any

import pytest

from ldt_core.base.errors import BadInput
from ldt_core.views.watch.fleet import Fleet
from ldt_core.views.watch.record_source import graph

rclpy = pytest.importorskip("rclpy")

from std_msgs.msg import Float64MultiArray, String  # noqa: E402
from stranger import PATIENCE, answer, experiment, prediction  # noqa: E402

from ldt_ros.nodes.twin_node import TwinNode  # noqa: E402
from ldt_ros.nodes.watch_node import WatchNode  # noqa: E402
from ldt_ros.watch import GraphSource  # noqa: E402


@pytest.fixture
def watched(stranger):
    """What a page would show of the stranger's domain."""
    fleet = Fleet()
    node = WatchNode(fleet, context=stranger.context)
    stranger.executor.add_node(node)
    yield fleet
    node.destroy_node()


def test_machines_are_found_as_they_come(stranger, watched):
    """By their topics with the right type; what else is in the domain is none of ours."""
    stranger.node.create_publisher(String, "chatter/experiment", 10)
    stranger.node.create_publisher(Float64MultiArray, "image", 10)
    stranger.send("press/experiment", experiment(1))
    stranger.send("mill/line_2/experiment", experiment(7))
    stranger.until(lambda: len(watched.machines) == 2, "both machines")
    stranger.send("press/experiment", experiment(2))
    stranger.send("press/prediction", prediction(2))
    stranger.send("press/signal", answer(2))
    stranger.until(lambda: watched.machine("/press")["card"]["level"] == -1, "the signal")
    assert watched.machine("/press")["numbers"][-1] == 2
    stranger.until(lambda: watched.experiment("/press", 2) is not None)
    assert set(watched.machines) == {"press", "mill/line_2"}


def test_a_machine_that_is_named_is_watched_before_it_is_there(stranger):
    """And no other."""
    fleet = Fleet()
    node = WatchNode(fleet, "press", context=stranger.context)
    stranger.executor.add_node(node)
    stranger.send("press/experiment", experiment(1))
    stranger.node.create_publisher(Float64MultiArray, "mill/experiment", 10)
    stranger.until(lambda: fleet.experiment("/press", 1), "the first experiment")
    stranger.spin(0.5)
    assert set(fleet.machines) == {"press"}
    node.destroy_node()


def test_samples_are_shown_while_a_machine_streams_them(stranger, watched):
    """Of a machine that is followed; without a velocity there is none."""
    from builtin_interfaces.msg import Time
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Header

    stranger.send("press/experiment", experiment(1))
    stranger.until(lambda: watched.machine("/press"), "the machine")
    publisher = stranger.node.create_publisher(JointState, "press/joint_states", 10)
    stranger.until(lambda: publisher.get_subscription_count(), "the listener")
    publisher.publish(JointState())
    for second in (5, 6):
        header = Header(stamp=Time(sec=second))
        publisher.publish(JointState(header=header, velocity=[float(second)]))
    stranger.until(lambda: len(watched.machine("/press").get("stream", ())) == 2, "the samples")
    assert watched.machine("/press")["stream"] == [(-1.0, 5.0), (0.0, 6.0)]


def test_what_is_malformed_is_counted_and_the_rest_shown(stranger, watched):
    """The page says what was wrong with the last one."""
    stranger.send("experiment", experiment(1))
    stranger.until(lambda: watched.machines, "the machine")
    stranger.send("experiment", Float64MultiArray(), experiment(2))
    stranger.until(lambda: 2 in watched.machine("/")["numbers"], "the good one")
    told = watched.machine("/")
    assert told["unreadable"] == 1
    assert "experiment" in told["last_unreadable"]


def test_it_publishes_nothing_and_nodes_are_told_of(stranger, watched):
    """It is an ear only; the twin's health is shown under its machine."""
    stranger.start(TwinNode, namespace="press", model="physics")
    stranger.until(lambda: watched.machines.get("press"), "the machine")
    stranger.until(lambda: watched.machine("/press")["nodes"], "its health")
    assert watched.machine("/press")["nodes"][0]["role"] == "twin"
    names = stranger.node.get_publisher_names_and_types_by_node("watch", "/")
    assert {name for name, _ in names} <= {"/rosout", "/parameter_events"}


def test_the_source_stops_at_once(domain):
    """And leaves nothing that runs."""
    source, stop, before = GraphSource("press"), threading.Event(), threading.active_count()
    thread = threading.Thread(target=source.run, args=(Fleet(), stop, lambda: None))
    thread.start()
    time.sleep(0.3)
    stop.set()
    thread.join(PATIENCE)
    assert not thread.is_alive()
    assert threading.active_count() == before


def test_a_namespace_that_cannot_exist_is_refused(domain):
    """In one sentence."""
    with pytest.raises(BadInput, match="namespace: expected words of letters"):
        graph("9 lives")


def machines(address: str) -> list[dict[str, Any]]:
    with urllib.request.urlopen(f"{address}machines", timeout=PATIENCE) as answered:
        return json.load(answered)["machines"]


def test_a_graph_of_two_machines_is_watched_live(domain, programs, tmp_path, short_rotor):
    """Found by themselves, judged, healthy; the samples are there; Ctrl-C ends it with 0."""

    def started(*arguments: str) -> subprocess.Popen[str]:
        code = "from ldt_core.cli import main; main()"
        return programs.start(
            [sys.executable, "-c", code, *arguments],
            cwd=tmp_path,
            text=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )

    watch = started("watch", "--port", "0", "--json")
    address = json.loads(watch.stdout.readline())["address"]
    assert machines(address) == []
    many = ("--machines", "2", "--experiments", "100000", "--rate", "20")
    with_model = ("--machine", short_rotor, "--model", "physics", "--bag", "run")
    up = started("up", *many, *with_model)
    end = time.monotonic() + 3 * PATIENCE
    while time.monotonic() < end:
        cards = {c["key"]: c for c in machines(address) if (c["experiment"] or 0) > 3}
        # The name comes with what the nodes tell of themselves, at the latest after a second.
        if len(cards) == 2 and all(c["machine"] for c in cards.values()):
            break
        time.sleep(0.1)
    assert set(cards) == {"/machine_1", "/machine_2"}
    assert {c["machine"] for c in cards.values()} == {"rotor"}
    assert all(c["error"] > 0 and c["trouble"] == "" for c in cards.values())
    number = cards["/machine_2"]["experiment"]
    query = f"experiment?machine=/machine_2&number={number}"
    with urllib.request.urlopen(address + query, timeout=PATIENCE) as answered:
        assert json.load(answered)["of"] == 200
    for process in (up, watch):
        process.send_signal(signal.SIGINT)
    ends = [p.communicate(timeout=3 * PATIENCE) for p in (up, watch)]
    assert (watch.returncode, ends[-1]) == (0, ("", ""))
    assert up.returncode == 0
