"""What a process needs in its environment before rclpy is imported, how rclpy begins, and its end.

For that reason nothing here imports rclpy at the top.
"""

from __future__ import annotations

import contextlib
import faulthandler
import importlib.util
import os
import re
import resource
import sys
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from ldt_core.base.clock import computer_time
from ldt_core.base.errors import BadInput
from ldt_core.security.permissions import domain_of_environment
from ldt_ros.graph.shared_memory import require_room

if TYPE_CHECKING:
    from rclpy.context import Context
    from rclpy.executors import Executor
    from rclpy.node import Node

    SomeNode = TypeVar("SomeNode", bound=Node)

LATEST = 2.0**31  # s since the epoch: a stamp counts them in 32 bits
LONGEST_END = 15.0  # s that it may take to leave the graph; `ldt up` waits for a node for 10
STDERR = 2  # its descriptor, which is there also where `sys.stderr` is not
#: Three times the 20 files that the process of a node, or of five machines, was seen to open.
LEAST_FILES = 64
MODULES = ("rclpy", "std_msgs", "diagnostic_msgs", "sensor_msgs")


def missing_modules() -> list[str]:
    """Of ROS 2, those that this Python lacks."""
    return [name for name in MODULES if importlib.util.find_spec(name) is None]


def require_ros() -> None:
    """Refuse to go on where ROS 2 cannot be used.

    Raises:
        BadInput: no ROS 2 in this Python, a domain that cannot exist, a full /dev/shm, a clock that
            is not set, or too few open files.
    """
    if missing := missing_modules():
        raise BadInput(
            "the node graph",
            "ROS 2 Jazzy in this Python (pip install 'ldt[ros]', or source a ROS 2 workspace)",
            f"no module {missing[0]}; `ldt run` does the same without ROS",
        )
    domain_of_environment()
    require_room()
    computer_time(LATEST, "ROS 2")
    if (most := resource.getrlimit(resource.RLIMIT_NOFILE)[0]) < LEAST_FILES:
        expected = f"a limit of at least {LEAST_FILES} for each process (ulimit -n {LEAST_FILES})"
        raise BadInput("open files", expected, most)


def ros_message(error: Exception | str) -> str:
    """What the ROS 2 libraries say, without their line breaks and their source positions."""
    return re.sub(r",? at /\S+:\d+", "", " ".join(str(error).split()))[:200]


def prepare(log_folder: Path | str | None = None) -> dict[str, str]:
    """Set what is missing in this process's environment, for itself and its children.

    What the user has set stays. Without a DDS profile of the user's, ours is taken: UDP on the
    loopback interface only, so that nothing leaves the machine, no shared-memory file is left
    behind, and a killed peer is noticed within seconds.
    """
    wanted = {
        # Our own profile whitelists 127.0.0.1; LOCALHOST would put other transports in its place.
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(resources.files("msgs_config") / "fastdds.xml"),
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "AMENT_PREFIX_PATH": sys.prefix,  # the wheels do not set it
        # One thread per process: results are bit-equal then, and the nodes share the cores anyway.
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    if log_folder is not None:
        wanted["ROS_LOG_DIR"] = str(log_folder)
    if "FASTDDS_DEFAULT_PROFILES_FILE" in os.environ:
        del wanted["FASTRTPS_DEFAULT_PROFILES_FILE"]
    for name, value in wanted.items():
        os.environ.setdefault(name, value)
    return dict(os.environ)


def begin(context: Context) -> None:
    """Initialise a context; signals stay with the process, and its terminal is its own.

    The library under rclpy remarks on standard error which enclave it has found.
    """
    import rclpy
    from rclpy.logging import LoggingSeverity, set_logger_level
    from rclpy.signals import SignalHandlerOptions

    set_logger_level("rcl", LoggingSeverity.WARN)
    rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)


def end_in_time() -> None:
    """End this process after `LONGEST_END`, unless that is cancelled: where it is, exit code 1.

    Fast DDS may wait for itself for ever where a participant is destroyed while others leave. It
    then holds Python's lock, so that no thread and no signal handler of Python's runs any more.
    """
    faulthandler.dump_traceback_later(LONGEST_END, exit=True, file=STDERR)


@contextlib.contextmanager
def spun_nodes(
    make: Callable[[Context], list[SomeNode]],
    expected: str = "a domain that a node can be created in",
    executor_type: Callable[..., Executor] | None = None,
) -> Iterator[tuple[list[SomeNode], Executor]]:
    """Nodes and what spins them, in a context of their own: the default one may be the caller's.

    Args:
        make: creates the nodes.
        expected: what is wanted of the surroundings, for the error.
        executor_type: of what spins them; None for `EventsExecutor`, which costs least.

    Raises:
        BadInput: no node can be created.
    """
    import rclpy
    from rclpy.experimental import EventsExecutor

    context = rclpy.Context()
    with contextlib.ExitStack() as stack:
        stack.callback(faulthandler.cancel_dump_traceback_later)
        stack.callback(rclpy.try_shutdown, context=context)
        try:
            begin(context)
            nodes = make(context)
        except Exception as error:
            raise BadInput("ROS 2", expected, ros_message(error)) from error
        executor = (executor_type or EventsExecutor)(context=context)
        stack.callback(executor.shutdown)
        for node in nodes:
            stack.callback(node.destroy_node)
            executor.add_node(node)
        stack.callback(end_in_time)
        yield nodes, executor
