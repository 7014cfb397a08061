"""`ldt learning`: an operator switches the learning of a twin off and on.

rclpy is imported where it is used: after `prepare`, and not for a recording.
"""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING, Any

import click

from ldt_core.base.errors import BadInput, LdtError
from ldt_core.cli.options import json_option, namespace_option
from ldt_core.cli.terminal import echo_result
from ldt_core.restart.learning_switch import LearningSwitch
from ldt_core.security.permissions import OPERATOR, check_namespace, enclave_name
from ldt_ros.graph.environment import prepare, require_ros, spun_nodes
from ldt_ros.graph.secure import OVERRIDE

if TYPE_CHECKING:
    from rclpy.context import Context
    from rclpy.executors import Executor
    from rclpy.node import Node

MEETING_TIMEOUT = 10.0  # s; who is there is met within 0.5, where the computer is not busy
ANSWER_TIMEOUT = 60.0  # s, of an adaptor that was met; it may be busy, or start again
ASK_AGAIN = 1.0  # s; an answer takes milliseconds
LEARNS = "active"  # state of a managed node
TRANSITIONS = {"on": "activate", "off": "deactivate"}


@click.command("learning", short_help="Switch the learning of a running twin off or on.")
@click.argument("wanted", type=click.Choice(["on", "off"]), required=False)
@click.option("--bag", default="", help="Recording of a run that has ended, instead of the graph.")
@namespace_option
@json_option
def command(wanted: str | None, bag: str, namespace: str, as_json: bool) -> None:
    """Show whether the twin of the running graph learns, or switch learning off or on.

    Use it during work on the machine. While learning is off, the twin predicts and judges as
    before; experiments of this time are never learned from later. It stays off after crashes and
    --resume; a replay of the recording learns from everything. This is the standard state of the
    adaptor, a managed node: ros2 lifecycle set /adaptor deactivate.

    Example: ldt learning off
    """
    found = _of_recording(bag, wanted) if bag else _of_graph(namespace, wanted)
    echo_result(as_json, {"learning": found}, f"learning is {found}")


def _of_recording(bag: str, wanted: str | None) -> str:
    from ldt_core.recording.bag import read_bag
    from ldt_core.recording.lock import is_written

    path = read_bag(bag, listed=True).path
    switch = LearningSwitch(path)
    if wanted:
        if is_written(path):
            expected = "a recording that nobody writes (without --bag the graph is asked)"
            raise BadInput(bag, expected, "one that is being written")
        if not switch.turn(off=wanted == "off"):
            raise LdtError(f"{bag}: cannot be written")
    return "off" if switch.is_off else "on"


def _of_graph(namespace: str, wanted: str | None) -> str:
    require_ros()
    adaptor = f"/{check_namespace(namespace)}/adaptor".replace("//", "/")
    os.environ.setdefault(OVERRIDE, enclave_name(OPERATOR, ""))  # counts where there is security
    prepare()
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState, GetState
    from rclpy import create_node
    from rclpy.executors import SingleThreadedExecutor

    def make(context: Context) -> list[Node]:
        quiet = create_node(
            OPERATOR, context=context, enable_rosout=False, start_parameter_services=False
        )
        return [quiet]

    with spun_nodes(make, executor_type=SingleThreadedExecutor) as ((node,), executor):

        def state() -> str:
            told = _answer(node, executor, GetState, adaptor, "get_state")
            return "on" if told.current_state.label == LEARNS else "off"

        found = state()
        if wanted and wanted != found:
            change = Transition(label=TRANSITIONS[wanted])
            _answer(node, executor, ChangeState, adaptor, "change_state", transition=change)
            found = state()
            if found != wanted:
                raise LdtError(
                    f"{adaptor}: learning is {found}, and could not be switched {wanted}"
                )
        return found


def _answer(
    node: Node, executor: Executor, kind: Any, adaptor: str, name: str, **asked: Any
) -> Any:
    """What the adaptor answers; it is asked again until it does, since an answer may be lost.

    A service is met by the one who asks before it has met him; then the answer goes nowhere.
    """
    service = f"{adaptor}/{name}"
    client = node.create_client(kind, service)
    began, patience = time.monotonic(), MEETING_TIMEOUT
    while (waited := time.monotonic() - began) < patience:
        if client.wait_for_service(timeout_sec=min(ASK_AGAIN, MEETING_TIMEOUT)):
            patience = ANSWER_TIMEOUT
            future = client.call_async(kind.Request(**asked))
            executor.spin_until_future_complete(future, timeout_sec=ASK_AGAIN)
            if future.done():
                return future.result()
            client.remove_pending_request(future)
    silent = f"no answer within {waited:.2g} s"
    if patience == ANSWER_TIMEOUT:
        raise LdtError(f"{service}: {silent} from the adaptor, which was met; see `ldt doctor`")
    expected = "an adaptor (of a graph that runs in this ROS_DOMAIN_ID; --namespace says of which)"
    raise BadInput(service, expected, silent)
