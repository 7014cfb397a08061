"""What a command costs before and behind its work: from the command to the prompt.

Of commands without ROS the processor time counts, which other work on the machine stretches least.
Of the graph it is the time that passes, by a listener beside it. Best of several rounds in turn.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from tests.benchmarks.bench_graph import BARE, DOMAIN, running
from tests.benchmarks.ear import Ear
from tests.benchmarks.row import Row, load_average
from tests.programs import LDT

ROUNDS = 5
PYTHON = [sys.executable, "-c"]
#: What is done → (arguments of `ldt`, what the peer is called, the peer's program, the aim).
COMMANDS = {
    "`ldt --help`": (["--help"], "Python that imports click", "import click", "under 0.2 s"),
    "`ldt run`, one experiment of 20 s": (
        ["run", "--experiments", "1", "--no-bag"],
        "Python that imports numpy, numba and scipy.linalg",
        "import numpy, numba, scipy.linalg",
        "under 0.8 s",
    ),
    "`ldt effects`": (["effects"], "Python that imports numba", "import numba", "under 0.8 s"),
}


def processor_time(command: Sequence[str]) -> float:
    """Of a program from its start to its end [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def alone() -> list[Row]:
    """Commands that compute little."""
    rows = []
    for name, (words, peer, program, aim) in COMMANDS.items():
        rounds = [
            (processor_time([*LDT, *words]), processor_time([*PYTHON, program]))
            for _ in range(ROUNDS)
        ]
        ours, other = (min(column) for column in zip(*rounds, strict=True))
        rows.append(Row(name, ours, peer, other, aim, f"processor time; {load_average()}"))
    return rows


def graph(folder: Path) -> list[Row]:
    """`ldt up` of one experiment."""
    first, prompt, bare = [], [], []
    with Ear("experiment", "prediction") as ear:
        for turn in range(ROUNDS):
            ear.clear()
            began = time.perf_counter()
            words = ["up", "--experiments", "1", "--bag", str(folder / str(turn))]
            program = subprocess.Popen([*LDT, *words], stdout=subprocess.DEVNULL)
            ear.until(lambda: bool(ear.heard["prediction"]))
            first.append(ear.heard["prediction"][0] - began)
            program.wait()
            prompt.append(time.perf_counter() - began)
            ear.clear()
            began = time.perf_counter()
            with running([*BARE, "lone"]):
                ear.until(lambda: bool(ear.heard["experiment"]))
                bare.append(ear.heard["experiment"][0] - began)
    peer = "a bare rclpy node: from the start of Python to the first message", min(bare)
    note = f"best of {ROUNDS}; {load_average()}"
    return [
        Row("`ldt up`: from the command to the first prediction", min(first), *peer, "", note),
        Row(
            "`ldt up`, one experiment: until the prompt returns",
            min(prompt),
            *peer,
            "under 2.5 s",
            note,
        ),
    ]


def run() -> list[Row]:
    """All of them."""
    os.environ["ROS_DOMAIN_ID"] = DOMAIN
    with tempfile.TemporaryDirectory() as name:
        return [*alone(), *graph(Path(name))]
