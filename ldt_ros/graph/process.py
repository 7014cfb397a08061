"""A process that hosts one or several nodes of the graph.

`python -m ldt_ros.graph.process --node twin --node detector --ros-args -p model:=linear`,
or one of the executables `ldt_plant`, `ldt_player`, `ldt_segmenter`, `ldt_twin`, `ldt_detector`,
`ldt_adaptor`, `ldt_diagnoser`, `ldt_advisor`, `ldt_recorder` for a single node. With namespaces and
files of parameters, `--machine press press.yaml --machine saw saw.yaml`, it hosts them for each.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import importlib
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, NoReturn

from ldt_core.base.errors import BadInput, LdtError
from ldt_core.base.own_process import OpenFiles, kept_alive, leave_at_once
from ldt_core.base.stopping import SIGNALS
from ldt_ros.graph.environment import end_in_time, prepare, require_ros, ros_message
from ldt_ros.graph.linux_process import end_with

if TYPE_CHECKING:
    from ldt_ros.nodes.node import LdtNode

ROLES = {
    "plant": "ldt_ros.nodes.experiment_source:PlantNode",
    "player": "ldt_ros.nodes.experiment_source:PlayerNode",
    "segmenter": "ldt_ros.nodes.segmenter_node:SegmenterNode",
    "twin": "ldt_ros.nodes.twin_node:TwinNode",
    "detector": "ldt_ros.nodes.detector_node:DetectorNode",
    "adaptor": "ldt_ros.nodes.adaptor_node:AdaptorNode",
    "diagnoser": "ldt_ros.nodes.diagnoser_node:DiagnoserNode",
    "advisor": "ldt_ros.nodes.advisor_node:AdvisorNode",
    "recorder": "ldt_ros.nodes.recorder_node:RecorderNode",
}
CRASHED = 70  # exit code of a program that an error of its own has ended (EX_SOFTWARE, sysexits)
FILES_CLOSED = "a part of your own has closed the files and sockets of this process"
HALT = signal.SIGUSR1  # by which a graph's process begins nothing new, and stays for those who miss
SPIN = 0.1  # s, how late a stop signal may be noticed when nothing arrives


def stop_event() -> threading.Event:
    """An event that SIGINT, SIGTERM and SIGHUP set, also those that came while they were blocked.

    rclpy's own handlers shut the context down before the last message is out, so they are not used.
    """
    asked = threading.Event()
    for number in SIGNALS:
        signal.signal(number, lambda *_: asked.set())
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    return asked


def halt_event() -> threading.Event:
    """The same of HALT."""
    asked = threading.Event()
    signal.signal(HALT, lambda *_: asked.set())
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [HALT])
    return asked


def main(arguments: list[str] | None = None, role: str = "") -> int:
    """Host the nodes until a stop signal, or one alone until it has finished.

    Args:
        arguments: of the process; None takes its own.
        role: of the node where the program hosts one alone.
    """
    own, ros = _parsed(sys.argv[1:] if arguments is None else arguments, role)
    stop = stop_event()
    if own.parent and not end_with(own.parent, signal.SIGTERM):
        return 1
    try:
        require_ros()
        prepare()
        # What a graph's source has sent is asked for again by a recorder that is started again.
        halted = halt_event().is_set if own.parent else None
        with kept_alive():
            return host(own.node, own.machine, ros, stop.is_set, halted)
    except LdtError as error:
        print(f"ldt {' '.join(own.node)}: {error}", file=sys.stderr)
        return error.exit_code
    except Exception:
        traceback.print_exc()
        return CRASHED


def _parsed(arguments: list[str], role: str) -> tuple[argparse.Namespace, list[str]]:
    """Our own arguments, and ROS's from `--ros-args` on."""
    at = arguments.index("--ros-args") if "--ros-args" in arguments else len(arguments)
    parser = argparse.ArgumentParser(
        prog=f"ldt_{role}" if role else "ldt_ros.graph.process",
        usage="%(prog)s [--ros-args -p NAME:=VALUE ...]" if role else None,
        description=f"Run the {role} of a graph alone." if role else "Host nodes of the graph.",
        epilog="After --ros-args follow ROS 2's own arguments, -p machine:=press.yaml for example. "
        "Parameters are the options of ldt up with underscores (ldt up --help-all), and graph "
        "(ldt docs connect).",
        allow_abbrev=False,
    )
    if role:
        parser.set_defaults(node=[role], machine=[], parent=None)
        return parser.parse_args(arguments[:at]), arguments[at:]
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


def node_class(role: str) -> Callable[..., LdtNode]:
    """Of the node that a role is played by."""
    module, _, name = ROLES[role].partition(":")
    found: Callable[..., LdtNode] = getattr(importlib.import_module(module), name)
    return found


def host(
    roles: list[str],
    machines: list[tuple[str, str]],
    ros_arguments: list[str],
    stopped: Callable[[], bool],
    halted: Callable[[], bool] | None = None,
) -> int:
    """Create the nodes, spin them, and close them in order.

    Args:
        roles: of the nodes.
        machines: namespace and file of parameters of each that has such nodes; none for the one
            that ROS's arguments are about.
        ros_arguments: of the process.
        stopped: whether it has been told to stop.
        halted: whether it has been told to begin nothing new; it then goes on until it is told to
            stop, although all nodes have finished. None where it ends by itself.
    """
    import rclpy
    from rclpy.experimental import EventsExecutor
    from rclpy.signals import SignalHandlerOptions

    try:
        rclpy.init(args=ros_arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # of which rclpy's own are kinds
        raise BadInput("ROS arguments", "what ROS 2 understands", ros_message(error)) from error
    nodes: list[LdtNode] = []
    with ExitStack() as destroying, ExitStack() as closing:
        destroying.callback(faulthandler.cancel_dump_traceback_later)
        destroying.callback(rclpy.try_shutdown)
        closing.callback(end_in_time)
        executor = EventsExecutor()
        own = ({"cli_args": machine_arguments(*m), "use_global_arguments": False} for m in machines)
        for arguments in [*own] or [{}]:
            for role in roles:
                node = node_class(role)(**arguments)
                destroying.callback(node.destroy_node)
                closing.callback(node.close)
                nodes.append(node)
                executor.add_node(node)
        for node in nodes:
            node.report.others = [other.report for other in nodes if other is not node]
        # EventsExecutor.spin() does not return on these wheels; spin_once does.
        files = OpenFiles()
        running = True
        while not (stopped() or (not halted and all(node.report.end_is_told for node in nodes))):
            executor.spin_once(timeout_sec=SPIN)
            if files.closed:  # sockets, too: an end in order would wait for them for ever
                with contextlib.suppress(OSError):
                    print(f"ldt {' '.join(roles)}: {FILES_CLOSED}", file=sys.stderr, flush=True)
                leave_at_once(LdtError.exit_code)
            if running and halted and halted():
                running = False
                for node in nodes:
                    node.halt()
            for node in nodes:
                if node.failure is not None:
                    raise node.failure
        for node in nodes:
            node.halt()
        deadline = time.monotonic() + max(node.patience for node in nodes)
        while time.monotonic() < deadline and not all(node.quiet for node in nodes):
            executor.spin_once(timeout_sec=SPIN)
    return 0


def machine_arguments(namespace: str, file: str) -> list[str]:
    """ROS's arguments by which nodes are those of one machine."""
    return ["--ros-args", "--params-file", file, "-r", f"__ns:=/{namespace}"]


def leave(code: int) -> NoReturn:
    """End without Python's own clean-up, which takes 0.3 s and has nothing left to do here."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _single(role: str) -> Callable[[], None]:
    """The executable of a node alone."""
    return lambda: leave(main(role=role))


plant, player, twin = _single("plant"), _single("player"), _single("twin")
detector, adaptor, recorder = _single("detector"), _single("adaptor"), _single("recorder")
diagnoser, segmenter = _single("diagnoser"), _single("segmenter")
advisor = _single("advisor")

if __name__ == "__main__":
    leave(main())
