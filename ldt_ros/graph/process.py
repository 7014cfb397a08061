"""A process that hosts one or several nodes of the graph.

`python -m ldt_ros.graph.process --node twin --node detector --ros-args -p model:=linear`,
or one of the executables `ldt_plant`, `ldt_player`, `ldt_segmenter`, `ldt_twin`, `ldt_detector`,
`ldt_adaptor`, `ldt_diagnoser`, `ldt_advisor`, `ldt_recorder` for a single node. With namespaces and
files of parameters, `--machine press press.yaml --machine saw saw.yaml`, it hosts them for each.
"""

from __future__ import annotations

import argparse
import importlib
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import ExitStack
from types import FrameType
from typing import Any, NoReturn

from ldt_core.base.errors import BadInput, LdtError
from ldt_ros.graph.environment import one_line, prepare, require_ros
from ldt_ros.graph.parentage import end_with

ROLES = {
    "plant": "ldt_ros.nodes.plant_node:PlantNode",
    "player": "ldt_ros.nodes.player_node:PlayerNode",
    "segmenter": "ldt_ros.nodes.segmenter_node:SegmenterNode",
    "twin": "ldt_ros.nodes.twin_node:PredictorNode",
    "detector": "ldt_ros.nodes.detector_node:DetectorNode",
    "adaptor": "ldt_ros.nodes.adaptor_node:AdaptorNode",
    "diagnoser": "ldt_ros.nodes.diagnoser_node:DiagnoserNode",
    "advisor": "ldt_ros.nodes.advisor_node:AdvisorNode",
    "recorder": "ldt_ros.nodes.recorder_node:RecorderNode",
}
CRASHED = 70  # exit code of a program that an error of its own has ended (EX_SOFTWARE, sysexits)
SPIN = 0.1  # s, how late a stop signal may be noticed when nothing arrives


class Stop:
    """Turns SIGINT and SIGTERM into a flag.

    rclpy's own handlers shut the context down before the last message is out, so they are not used.
    """

    #: Which they are; they may be blocked until then, and one that has come meanwhile counts.
    SIGNALS = (signal.SIGINT, signal.SIGTERM)

    def __init__(self) -> None:
        self.asked = False
        for number in self.SIGNALS:
            signal.signal(number, self._ask)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, self.SIGNALS)

    def _ask(self, _number: int, _frame: FrameType | None) -> None:
        self.asked = True


def main(arguments: list[str] | None = None) -> int:
    """Host the nodes until a stop signal, or until one that ends by itself has finished."""
    own, ros = _parsed(sys.argv[1:] if arguments is None else arguments)
    stop = Stop()
    if own.parent and not end_with(own.parent, signal.SIGTERM):
        return 1
    try:
        require_ros()
        prepare()
        return host(own.node, own.machine, ros, lambda: stop.asked)
    except LdtError as error:
        print(f"ldt {' '.join(own.node)}: {error}", file=sys.stderr)
        return error.exit_code
    except Exception:
        traceback.print_exc()
        return CRASHED


def _parsed(arguments: list[str]) -> tuple[argparse.Namespace, list[str]]:
    """Our own arguments, and ROS's from `--ros-args` on."""
    at = arguments.index("--ros-args") if "--ros-args" in arguments else len(arguments)
    parser = argparse.ArgumentParser(
        prog="ldt_ros.graph.process",
        description="Host nodes of the graph.",
        epilog="After --ros-args follow ROS 2's own arguments, -p threshold:=1.5 for example.",
        allow_abbrev=False,
    )
    parser.add_argument("--node", action="append", choices=ROLES, required=True)
    parser.add_argument(
        "--machine",
        action="append",
        nargs=2,
        default=[],
        metavar=("NAMESPACE", "FILE"),
        help="host the nodes for this machine, with the parameters in a file; may be repeated",
    )
    parser.add_argument("--parent", type=int, metavar="PID", help="end when this process ends")
    return parser.parse_args(arguments[:at]), arguments[at:]


def node_class(role: str) -> Any:
    """Of the node that a role is played by."""
    module, _, name = ROLES[role].partition(":")
    return getattr(importlib.import_module(module), name)


def host(
    roles: list[str],
    machines: list[tuple[str, str]],
    ros_arguments: list[str],
    stopped: Callable[[], bool],
) -> int:
    """Create the nodes, spin them, and close them in order.

    Args:
        roles: of the nodes.
        machines: namespace and file of parameters of each that has such nodes; none for the one
            that ROS's arguments are about.
        ros_arguments: of the process.
        stopped: whether it has been told to stop.
    """
    import rclpy
    from rclpy.experimental import EventsExecutor
    from rclpy.signals import SignalHandlerOptions

    try:
        rclpy.init(args=ros_arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # of which rclpy's own are kinds
        raise BadInput("ROS arguments", "what ROS 2 understands", one_line(error)) from error
    nodes: list[Any] = []
    with ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        executor = EventsExecutor()
        for arguments in [_own(*machine) for machine in machines] or [{}]:
            for role in roles:
                node = node_class(role)(**arguments)
                stack.callback(node.destroy_node)
                stack.callback(node.close)
                nodes.append(node)
                executor.add_node(node)
        for node in nodes:
            node.colleagues = [other for other in nodes if other is not node]
        # EventsExecutor.spin() does not return on these wheels; spin_once does.
        while not (stopped() or _all_done(nodes)):
            executor.spin_once(timeout_sec=SPIN)
            for node in nodes:
                if node.failure is not None:
                    raise node.failure
        for node in nodes:
            node.halt()
        deadline = time.monotonic() + max(getattr(n, "patience", 0.0) for n in nodes)
        while time.monotonic() < deadline and not all(getattr(n, "quiet", True) for n in nodes):
            executor.spin_once(timeout_sec=SPIN)
    return 0


def _own(namespace: str, file: str) -> dict[str, Any]:
    """Arguments of a node of one machine, in a process that hosts those of several."""
    return {"cli_args": machine_arguments(namespace, file), "use_global_arguments": False}


def machine_arguments(namespace: str, file: str) -> list[str]:
    """ROS's arguments by which nodes are those of one machine.

    Args:
        namespace: of its topics, "" for the root.
        file: of its parameters.
    """
    return ["--ros-args", "--params-file", file, "-r", f"__ns:=/{namespace}"]


def _all_done(nodes: list[Any]) -> bool:
    """Whether every node has told that it is finished; a node with more to do never is."""
    return all(node.done for node in nodes)


def leave(code: int) -> NoReturn:
    """End without Python's own clean-up, which takes 0.3 s and has nothing left to do here."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _single(role: str) -> Callable[[], None]:
    def start() -> None:
        leave(main(["--node", role, *sys.argv[1:]]))

    start.__doc__ = f"Host the {role} node alone."
    return start


plant, player, twin = _single("plant"), _single("player"), _single("twin")
detector, adaptor, recorder = _single("detector"), _single("adaptor"), _single("recorder")
diagnoser, segmenter = _single("diagnoser"), _single("segmenter")
advisor = _single("advisor")

if __name__ == "__main__":
    leave(main())
