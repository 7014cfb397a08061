"""Trials of the middleware, each in a process of its own, because the middleware can end it.

`python -m ldt_ros.graph.middleware_trials NAME …` conducts one; what it found is one JSON object.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import msgs_config
from ldt_ros.graph.environment import begin, prepare
from ldt_ros.graph.linux_process import end_with
from ldt_ros.graph.process import leave

if TYPE_CHECKING:
    from rclpy.node import Node

NODE_PREFIX = "ldt_doctor"  # of all nodes of the doctor, so that they do not report each other
DISCOVERY_TIME = 0.6  # s; others are met within 0.25 s
SECURE_DISCOVERY_TIME = 0.8  # s; whoever can be met is met within 0.5
MESSAGE_TIMEOUT = 7.0  # s for the message
SPIN = 0.02  # s
POLL = 0.05  # s
TOPIC = "/rosout"  # every node may publish it
UNKNOWN = "_NODE_NAME_UNKNOWN_"  # of a publisher that is met before its node


@contextlib.contextmanager
def trial(
    name: str, *arguments: str, environment: Mapping[str, str]
) -> Iterator[subprocess.Popen[str]]:
    """The process of a trial; it is ended with the context."""
    process = subprocess.Popen(
        # -P: nothing in the user's folder may stand in for a module of ours.
        [sys.executable, "-P", "-m", __name__, name, *arguments, str(os.getpid())],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=dict(environment),
        start_new_session=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def dds_library() -> str | None:
    """The file of the DDS library that this process has loaded."""
    for line in Path("/proc/self/maps").read_text().splitlines():
        path = line.rpartition(" ")[2]
        if Path(path).name.startswith(("libfastrtps.", "libfastdds.")):
            return path
    return None


def voice(topic: str) -> dict[str, Any]:
    """Speak on a topic as the nodes of a graph do, until it is ended."""
    from std_msgs.msg import String

    publisher = _node(f"{NODE_PREFIX}_voice_{os.getpid()}").create_publisher(String, topic, 10)
    end = time.monotonic() + MESSAGE_TIMEOUT
    while time.monotonic() < end:
        publisher.publish(String(data=repr(time.monotonic())))
        time.sleep(SPIN)
    return {}


def ear(topic: str) -> dict[str, Any]:
    """Listen to the voice, look round in the domain, and tell what was met."""
    from rclpy.experimental import EventsExecutor
    from rclpy.utilities import get_rmw_implementation_identifier
    from std_msgs.msg import String

    delays: list[float] = []

    def hear(message: String) -> None:
        delays.append(time.monotonic() - float(message.data))

    node = _node(f"{NODE_PREFIX}_ear_{os.getpid()}")
    node.create_subscription(String, topic, hear, 10)
    executor = EventsExecutor(context=node.context)
    executor.add_node(node)
    began = time.monotonic()
    while (passed := time.monotonic() - began) < MESSAGE_TIMEOUT:
        executor.spin_once(timeout_sec=SPIN)
        if delays and passed > DISCOVERY_TIME:
            break
    met = node.get_node_names_and_namespaces()
    ours = {t for t in msgs_config.topics() if not t.startswith("/")}
    topics = [t for t, _ in node.get_topic_names_and_types() if t.rpartition("/")[2] in ours]
    return {
        "received": len(delays),
        "delay_s": min(delays, default=None),
        "rmw": get_rmw_implementation_identifier(),
        "nodes": sorted(f"{s.rstrip('/')}/{n}" for n, s in met if not n.startswith(NODE_PREFIX)),
        "publishers": [t for t in topics if node.count_publishers(t)],
        "middleware": dds_library(),
    }


def enclave() -> dict[str, Any]:
    """Why no participant is in its enclave (`failure`), or whether one without security sees it.

    Returns:
        `failure`, "" where there is none; `seen`; `rmw`.
    """
    asked = os.environ.get("ROS_SECURITY_ENABLE", "")
    from rclpy.utilities import get_rmw_implementation_identifier

    os.environ["ROS_SECURITY_ENABLE"] = "false"
    outside = _node("outside")
    time.sleep(SECURE_DISCOVERY_TIME)  # others who are there already are not meant
    before = {bytes(i.endpoint_gid) for i in outside.get_publishers_info_by_topic(TOPIC)}
    told = {"failure": "", "seen": False, "rmw": get_rmw_implementation_identifier()}
    os.environ["ROS_SECURITY_ENABLE"] = asked
    try:
        inside = _node("monitor", enable_rosout=True)  # as its permissions call it
    except Exception as error:  # whatever the middleware has against it
        told["failure"] = str(error)
    else:
        told["seen"] = _meets_monitor(outside, before)
        inside.destroy_node()
    return told


TRIALS: dict[str, Callable[..., dict[str, Any]]] = {"voice": voice, "ear": ear, "enclave": enclave}


def _node(name: str, enable_rosout: bool = False) -> Node:
    """A node in a context of its own, which reads its security from the environment."""
    import rclpy

    context = rclpy.Context()
    begin(context)
    return rclpy.create_node(
        name, context=context, enable_rosout=enable_rosout, start_parameter_services=False
    )


def _meets_monitor(node: Node, known: set[bytes]) -> bool:
    """Whether the node meets, within the time, somebody new who may be the other one."""
    end = time.monotonic() + SECURE_DISCOVERY_TIME
    while time.monotonic() < end:
        for info in node.get_publishers_info_by_topic(TOPIC):
            new = bytes(info.endpoint_gid) not in known
            if new and info.node_name in ("monitor", UNKNOWN):
                return True
        time.sleep(POLL)
    return False


def _conduct(name: str, *arguments: str) -> NoReturn:
    """Do what this process is for, print what was found as JSON, and end."""
    *own, parent = arguments
    if not end_with(int(parent), signal.SIGKILL):
        leave(1)
    prepare()
    print(json.dumps(TRIALS[name](*own)), flush=True)
    leave(0)


if __name__ == "__main__":
    _conduct(*sys.argv[1:])
