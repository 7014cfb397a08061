"""The process that those of the nodes come from: it has imported what they need, and forks.

A process of its own, in which nothing runs but this: whoever starts a graph may have threads, and a
fork copies only one of them. It never creates a node, so that there is no middleware to copy. What
it forks becomes a child of the process that asked for it, by way of a process in between that ends
at once; so a node outlives this server, and its parent learns its exit code.

The fork server of `multiprocessing` does not do: there is one a process, with the environment of
its start; it imports the user's script anew in each child, and takes all for dead when it ends.

Where rclpy is linked with LTTng, two threads of that library wait here for a session daemon.
Whoever traces a graph preloads `liblttng-ust-fork.so`, as LTTng asks of programs that fork.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import signal
import socket
import sys
import time
import traceback
from typing import Any, NoReturn

import rclpy.experimental  # noqa: F401  for the forks

import msgs_config
from ldt_core.base.errors import LdtError
from ldt_core.base.settings import resolve
from ldt_core.base.stopping import SIGNALS
from ldt_core.detectors import DETECTORS
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.models import MODELS, build_model
from ldt_core.physics import PHYSICS
from ldt_core.recording.messages import schema
from ldt_core.twin.predictor import Predictor
from ldt_ros.graph import process
from ldt_ros.graph.linux_process import end_with, entitle

REQUEST = 65536  # bytes of one request at most; parameters are in a file
POLL = 0.0005  # s between two looks whether the process in between has ended
#: Whose messages nodes have, those that rclpy gives every node among them.
PACKAGES = (
    *("rcl_interfaces.msg", "rcl_interfaces.srv", "type_description_interfaces.srv"),
    *("diagnostic_msgs.msg", "sensor_msgs.msg", "std_msgs.msg"),
    *("lifecycle_msgs.msg", "lifecycle_msgs.srv"),
)


def main(channel: socket.socket, parent: int) -> int:
    """Serve until the other end of the channel is closed.

    Args:
        channel: brings what to prepare for, a JSON object of settings, and then requests: a JSON
            list of the arguments of `ldt_ros.graph.process` each, and with it the file that
            the output goes to. Takes the answers, a process id or a sentence.
        parent: process that asks; the server ends with it.
    """
    if not end_with(parent, signal.SIGKILL):
        return 1
    entitle("-m", "ldt_ros.graph.fork_server")
    gc.disable()  # all that is made here stays
    preload()
    warm_up(json.loads(channel.recv(REQUEST)))
    # What is there now is never garbage; collecting it would copy the pages that processes share.
    gc.collect()
    gc.freeze()
    gc.enable()
    while True:
        request, files, _, _ = socket.recv_fds(channel, REQUEST, 1)
        if not request:
            return 0
        arguments = json.loads(request)
        try:
            _fork(channel, files[0], arguments, parent)
        except OSError as error:
            channel.send(str(error).encode())
        os.close(files[0])


def preload() -> None:
    """Import what nodes need, and prepare what every one of them would prepare by itself."""
    for role in process.ROLES:
        process.node_class(role)
    for package in PACKAGES:
        for kind in vars(importlib.import_module(package)).values():
            if hasattr(kind, "__import_type_support__"):
                kind.__import_type_support__()
    msgs_config.parameters()
    msgs_config.qos_profiles()
    for declared in msgs_config.topics().values():
        schema(declared["type"])


def warm_up(settings: dict[str, Any]) -> None:
    """Load the code that the parts of a graph of this machine, model and detector begin with.

    A user's own parts are left to the nodes: whatever these do must not happen here.
    """
    with contextlib.suppress(LdtError):  # the node that comes by it says so
        resolved = resolve(settings)
        if resolved["detector"] in DETECTORS.builtin:
            DETECTORS.get(resolved["detector"])
        machine = load_machine(resolved["machine"])
        if machine.physics in PHYSICS.builtin and resolved["model"] in MODELS.builtin:
            model = build_model(resolved["model"], machine, resolved)
            Predictor(machine, model).warm_up()
            Plant.from_settings(machine, resolved).experiment(1)


def _fork(channel: socket.socket, output: int, arguments: list[str], parent: int) -> None:
    between = os.fork()
    if between:
        os.waitpid(between, 0)
        return
    between = os.getpid()
    try:
        if os.fork():
            os._exit(0)
    except OSError as error:
        channel.send(str(error).encode())
        os._exit(1)
    _become(channel, output, arguments, parent, between)


def _become(
    channel: socket.socket, output: int, arguments: list[str], parent: int, between: int
) -> NoReturn:
    """Be the process of a node from here on."""
    code = process.CRASHED
    try:
        os.setsid()
        nothing = os.open(os.devnull, os.O_RDONLY)
        for source, target in ((nothing, 0), (output, 1), (output, 2)):
            os.dup2(source, target)
        os.close(nothing)
        os.close(output)
        while os.getppid() == between:
            time.sleep(POLL)
        entitle("-m", "ldt_ros.graph.process", *arguments)
        # From the moment it is known, it may be told to stop.
        signal.pthread_sigmask(signal.SIG_BLOCK, (*SIGNALS, process.HALT))
        channel.send(str(os.getpid()).encode())
        channel.close()
        code = process.main(["--parent", str(parent), *arguments])
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else process.CRASHED
    except BaseException:
        traceback.print_exc()
    finally:
        process.leave(code)


if __name__ == "__main__":
    sys.exit(main(socket.socket(fileno=int(sys.argv[1])), int(sys.argv[2])))
