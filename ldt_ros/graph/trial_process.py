"""Trials of the middleware, each in a process of its own, because the middleware can end it.

A trial is a module that `python -m` runs by `conduct`; what it found is one JSON object.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NoReturn

from ldt_ros.graph.parentage import end_with
from ldt_ros.graph.process import leave


@contextlib.contextmanager
def trial(
    module: str, *arguments: str, environment: Mapping[str, str]
) -> Iterator[subprocess.Popen[str]]:
    """The process of a trial; it is ended with the context.

    Args:
        module: that conducts it.
        arguments: of the function that it conducts.
        environment: of the process.
    """
    process = subprocess.Popen(
        # -P: nothing in the user's folder may stand in for a module of ours.
        [sys.executable, "-P", "-m", module, *arguments, str(os.getpid())],
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


def conduct(attempt: Callable[..., dict[str, Any]]) -> NoReturn:
    """Do what this process is for, print what was found as JSON, and end.

    Args:
        attempt: given the arguments of the process but the last, which is its parent.
    """
    *arguments, parent = sys.argv[1:]
    if not end_with(int(parent), signal.SIGKILL):
        leave(1)
    print(json.dumps(attempt(*arguments)), flush=True)
    leave(0)
