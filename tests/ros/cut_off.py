"""A graph on two hosts, of which one is cut off for a while."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from disturbed import adaptations
from network import HOSTS, parted

from ldt_core import docs

PAGE = docs.text("network")
PROFILE = re.search(r"```xml\n(.*?)```", PAGE, re.S)[1]  # type: ignore[index]
SERVED = re.sub(r" *<initialPeersList>.*</initialPeersList>\n", "", PROFILE, flags=re.S)
SERVER = re.search(r'python -c "(import os; os.exec.*)"', PAGE)[1]  # type: ignore[index]
ROLES = ("recorder", "adaptor", "detector", "twin", "plant")
PATIENCE = 120  # s
NULL = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}

Start = Callable[..., Any]


def server(host: list[str], start: Start) -> dict[str, str]:
    """Start a discovery server on the first host; what the nodes' environment must say of it."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("FAST", "ROS_"))}
    start([*host, sys.executable, "-c", SERVER], env={**clean, "PATH": path}, **NULL)
    return {"ROS_DISCOVERY_SERVER": f"{HOSTS[0]}:11811"}


def run_cut(
    hosts: list[list[str]],
    start: Start,
    folder: Path,
    profile: str,
    environment: dict[str, str],
    settings: dict[str, Any],
    *cuts: tuple[int, float],
) -> None:
    """Record a run into `folder/rough`: the plant on the one host, all else on the other.

    Args:
        hosts: what to put before a command to run it on each.
        start: of programs.
        folder: of the run.
        profile: of Fast DDS.
        environment: beside it.
        settings: of the nodes.
        cuts: after how many recorded experiments the hosts are parted, and for how long [s].
    """
    (folder / "profile.xml").write_text(profile)
    given = {**settings, "bag": "rough", "graph": f"[{','.join(ROLES)}]"}
    ros = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
    env = {**os.environ, "FASTRTPS_DEFAULT_PROFILES_FILE": str(folder / "profile.xml")}
    env |= environment
    nodes = []
    for host, roles in zip(hosts, (ROLES[-1:], ROLES[:-1]), strict=True):
        own = [word for role in roles for word in ("--node", role)]
        command = [*host, sys.executable, "-m", "ldt_ros.graph.process", *own, "--ros-args", *ros]
        nodes.append(start(command, env=env, cwd=folder, **NULL))
    for after, seconds in cuts:
        wait(folder / "rough", after)
        with parted(hosts[0]):
            time.sleep(seconds)
    wait(folder / "rough", int(settings["experiments"]))
    for process in nodes:
        process.terminate()
        process.wait(PATIENCE)


def wait(recording: Path, number: int) -> None:
    """Until what was done about this experiment is recorded."""
    deadline = time.monotonic() + PATIENCE
    while (last := max((a.experiment for a in adaptations(recording)), default=0)) < number:
        if time.monotonic() > deadline:
            raise TimeoutError(f"{recording} ends with {last} after {PATIENCE} s")
        time.sleep(0.1)
