"""The running graph as the source of the live page: machines are found, nothing is sent.

rclpy is imported where it is used: after `prepare`.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from ldt_core.security.permissions import check_namespace, enclave_name
from ldt_core.views.watch.fleet import Fleet
from ldt_ros.graph.environment import prepare, require_ros, spun_nodes
from ldt_ros.graph.secure import OVERRIDE

if TYPE_CHECKING:
    from rclpy.context import Context

SPIN = 0.1  # s, how late a stop may be noticed when nothing arrives


class GraphSource:
    """Every machine of the domain, or one.

    Args:
        namespace: of the machine; "" for all that there are.

    Raises:
        BadInput: no ROS 2, or a namespace that cannot exist.
    """

    live = True

    def __init__(self, namespace: str = "") -> None:
        require_ros()
        os.environ.setdefault(OVERRIDE, enclave_name("watch", ""))  # counts where there is security
        prepare()
        self.namespace = check_namespace(namespace)
        self.words = f"machine {self.namespace}" if self.namespace else "the running graph"

    def run(self, fleet: Fleet, stop: threading.Event, begun: Callable[[], object]) -> None:
        """Feed the fleet until told to stop.

        Raises:
            BadInput: a domain in which no node can be created.
        """
        from ldt_ros.nodes.watch_node import WatchNode

        def make(context: Context) -> list[WatchNode]:
            return [WatchNode(fleet, self.namespace, context=context)]

        with spun_nodes(make) as (_, executor):
            begun()
            fleet.say("live: the running graph")
            while not stop.is_set():
                executor.spin_once(timeout_sec=SPIN)
