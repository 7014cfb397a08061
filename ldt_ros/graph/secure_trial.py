"""Two participants of one process, one in an enclave and one without security, as a trial.

It tells why the first could not be made, or whether the second sees it.
"""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING, Any

from ldt_ros.graph.environment import begin, prepare
from ldt_ros.graph.trial_process import conduct

if TYPE_CHECKING:
    from rclpy.node import Node

DISCOVERY_TIME = 0.8  # s; whoever can be met is met within 0.5
POLL = 0.05  # s
TOPIC = "/rosout"  # every node may publish it
UNKNOWN = "_NODE_NAME_UNKNOWN_"  # of a publisher that is met before its node


def main() -> dict[str, Any]:
    """Why none is in the enclave (`failure`), whether it is `seen`, and by which `rmw`."""
    asked = os.environ.get("ROS_SECURITY_ENABLE", "")
    prepare()
    from rclpy.utilities import get_rmw_implementation_identifier

    outside = _node("outside", "false")
    time.sleep(DISCOVERY_TIME)  # others who are there already are not meant
    before = {bytes(i.endpoint_gid) for i in outside.get_publishers_info_by_topic(TOPIC)}
    told: dict[str, Any] = {
        "failure": "",
        "seen": False,
        "rmw": get_rmw_implementation_identifier(),
    }
    try:
        inside = _node("monitor", asked)  # as its permissions call it
    except Exception as error:  # whatever the middleware has against it
        told["failure"] = str(error)
    else:
        told["seen"] = _look(outside, before)
        inside.destroy_node()
    return told


def _node(name: str, secured: str) -> Node:
    """A node in a context of its own, which reads its security from the environment."""
    import rclpy

    os.environ["ROS_SECURITY_ENABLE"] = secured
    context = rclpy.Context()
    begin(context)
    log = name != "outside"
    return rclpy.create_node(
        name, context=context, enable_rosout=log, start_parameter_services=False
    )


def _look(node: Node, known: set[bytes]) -> bool:
    """Whether the node meets, within the time, somebody new who may be the other one."""
    end = time.monotonic() + DISCOVERY_TIME
    while time.monotonic() < end:
        for info in node.get_publishers_info_by_topic(TOPIC):
            new = bytes(info.endpoint_gid) not in known
            if new and info.node_name in ("monitor", UNKNOWN):
                return True
        time.sleep(POLL)
    return False


if __name__ == "__main__":
    conduct(main)
