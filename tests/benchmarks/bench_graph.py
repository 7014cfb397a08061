"""One cycle of the node graph against the same messages between as many nodes that do nothing."""

from __future__ import annotations

import contextlib
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from ldt_core.machine import load_machine
from ldt_core.plant import Plant
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import BagWriter
from tests.benchmarks.bare_node import ROLES, SKIPPED
from tests.benchmarks.row import Row

CYCLES = 200
TRIES = 3
ENDLESS = 1_000_000
DOMAIN = "231"  # ours alone: the last but one that the ports allow


def bare_cycle() -> float:
    """Median cycle of nodes that only pass messages on [s].

    They have no gate at the start as our graph has, so that a first message may be lost and all
    wait for ever; then it is tried again.
    """
    for _ in range(TRIES - 1):
        with contextlib.suppress(subprocess.TimeoutExpired):
            return _bare_cycle()
    return _bare_cycle()


def _bare_cycle() -> float:
    command = [sys.executable, "-m", "tests.benchmarks.bare_node"]
    passing = [r for r in ROLES if r != "source"]
    others = [subprocess.Popen([*command, role, str(ENDLESS)]) for role in passing]
    try:
        source = subprocess.run(
            [*command, "source", str(CYCLES)],
            check=True,
            capture_output=True,
            text=True,
            timeout=20,
        )
        return float(source.stdout)
    finally:
        for process in others:
            process.kill()
            process.wait()


def our_cycle(folder: Path) -> float:
    """Median cycle of the graph that predicts, judges and records a stream without drift [s]."""
    from ldt_ros.up import launch

    machine = load_machine("rotor")
    plant = Plant(machine, experiments=CYCLES, seed=1, degradation="none", start_time=1e9)
    with BagWriter(folder / "stream", machine=machine.name) as writer:
        for number in range(1, CYCLES + 1):
            experiment = plant.experiment(number)
            writer.write("experiment", experiment, experiment.end)
    settings = {"play": str(folder / "stream"), "bag": str(folder / "run"), "model": "physics"}
    launch({**settings, "threshold": 1000.0})
    stamps = [m.time_ns for m in read_bag(folder / "run").messages("experiment")]
    return statistics.median(np.diff(stamps[SKIPPED:])) / 1e9


def run() -> list[Row]:
    """The ratio of the two."""
    os.environ["ROS_DOMAIN_ID"] = DOMAIN
    with tempfile.TemporaryDirectory() as folder:
        ours = our_cycle(Path(folder))
    return [
        Row(
            "one cycle of the graph, 2000 samples, 5 processes, recorded",
            ours,
            "bare rclpy nodes passing the same messages",
            bare_cycle(),
            "at least 1/2",
        )
    ]
