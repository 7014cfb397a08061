"""The running graph as the source of the live page: machines are found, nothing is sent."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable

from ldt_core.base.errors import BadInput
from ldt_core.security.permissions import enclave_name
from ldt_core.views.watch.fleet import Fleet
from ldt_ros.graph.environment import begin, one_line, prepare, require_ros
from ldt_ros.graph.secure import OVERRIDE

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
        from rclpy.exceptions import InvalidNamespaceException
        from rclpy.validate_namespace import validate_namespace

        self.namespace = namespace.strip("/")
        try:
            validate_namespace(f"/{self.namespace}")
        except InvalidNamespaceException as error:
            words = "words of letters, digits and underscores, joined by slashes"
            raise BadInput("namespace", words, repr(namespace)) from error
        self.words = f"machine {self.namespace}" if self.namespace else "the running graph"

    def run(self, fleet: Fleet, stop: threading.Event, begun: Callable[[], object]) -> None:
        """Feed the fleet until told to stop.

        Raises:
            BadInput: a domain in which no node can be created.
        """
        import rclpy
        from rclpy.experimental import EventsExecutor

        from ldt_ros.nodes.watch_node import WatchNode

        context = rclpy.Context()
        try:
            begin(context)
            ear = WatchNode(fleet, self.namespace, context=context)
        except Exception as error:
            rclpy.try_shutdown(context=context)
            what = "a domain that a node can be created in"
            raise BadInput("ROS 2", what, one_line(error)) from error
        executor = EventsExecutor(context=context)
        executor.add_node(ear)
        begun()
        fleet.say("live: the running graph")
        try:
            while not stop.is_set():
                executor.spin_once(timeout_sec=SPIN)
        finally:
            ear.destroy_node()
            executor.shutdown()
            rclpy.try_shutdown(context=context)
