"""The node graph against nodes that do nothing: start-up, a cycle, latency; and a replay.

The graph is `ldt up` as a user calls it, and everything is timed by a listener beside it. Best of
several rounds in turn, since whatever else the machine does only makes times longer.
"""

from __future__ import annotations

import contextlib
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import psutil

from ldt_core.machine import load_machine
from ldt_core.plant import Plant
from ldt_core.recording.writer import BagWriter
from tests.benchmarks.bare_node import ROLES, SKIPPED
from tests.benchmarks.ear import Ear
from tests.benchmarks.row import Row

CYCLES = 500
REPLAYED = 200
ROUNDS = 5
DOMAIN = "231"  # ours alone: the last but one that the ports allow
LDT = [sys.executable, "-c", "from ldt_core.cli import main; main()"]
BARE = [sys.executable, "-m", "tests.benchmarks.bare_node"]
ENDLESS = "1000000"


@contextlib.contextmanager
def running(*commands: Sequence[str | Path]) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Programs, ended at the end: ours as by Ctrl-C, bare nodes by force."""
    programs = [subprocess.Popen(c, stdout=subprocess.DEVNULL) for c in commands]
    try:
        yield programs
    finally:
        for program, command in zip(programs, commands, strict=True):
            program.send_signal(signal.SIGINT if "up" in command else signal.SIGKILL)
        for program in programs:
            try:
                program.wait(20)
            except subprocess.TimeoutExpired:
                program.kill()
                program.wait()


def memory(program: int) -> float:
    """Of a program and all that it has started, shared pages divided among the sharers [MB]."""
    total = 0
    one = psutil.Process(program)
    for process in (one, *one.children(recursive=True)):
        with contextlib.suppress(psutil.Error):
            total += process.memory_full_info().pss
    return total / 1e6


def start_up() -> Row:
    """From the start of the program to the first message that a listener hears."""
    ours, bare, used = [], [], []
    with Ear("experiment") as ear:
        for _ in range(ROUNDS):
            for command, times in ((graph(), ours), ([*BARE, "lone", ENDLESS], bare)):
                ear.clear()
                began = time.perf_counter()
                with running(command) as (program,):
                    ear.until(lambda: bool(ear.heard["experiment"]))
                    times.append(ear.heard["experiment"][0] - began)
                    if times is ours:
                        used.append(memory(program.pid))
    return Row(
        "start-up of the whole graph: start of `ldt up` to first `experiment` heard",
        min(ours),
        "a bare rclpy node: start of Python to first message heard",
        min(bare),
        "at least 1/3",
        f"launcher and 5 nodes hold {statistics.median(used):.0f} MB; best of {ROUNDS}",
    )


def graph(*options: str | Path) -> list[str | Path]:
    """The command of an endless run, with the default model and detector."""
    if not options:
        options = ("--experiments", ENDLESS)
    folder = Path(tempfile.mkdtemp(prefix="ldt-benchmark-"))
    return [*LDT, "up", "--bag", folder / "run", *options]


def cycles(folder: Path) -> list[Row]:
    """Of experiments without drift: the time of a whole cycle, and from sample in to signal out."""
    play = ("--play", stream(folder, CYCLES), "--model", "physics", "--threshold", "1000")
    bare = [[*BARE, role, ENDLESS] for role in ROLES]
    found: dict[str, list[tuple[float, float]]] = {"ours": [], "bare": []}
    with Ear("experiment", "signal") as ear:
        for _ in range(ROUNDS):
            for name, commands in (("ours", [graph(*play)]), ("bare", bare)):
                ear.clear()
                with running(*commands):
                    ear.until(lambda: len(ear.heard["signal"]) >= CYCLES)
                sent, judged = (np.array(ear.heard[t][SKIPPED:CYCLES]) for t in ear.heard)
                late = float(np.quantile(judged - sent, 0.99))
                found[name].append((float(np.median(np.diff(sent))), late))
    (ours, ours_late), (peer, peer_late) = (
        (min(c for c, _ in rounds), min(late for _, late in rounds)) for rounds in found.values()
    )
    who = "bare rclpy nodes passing the same messages"
    rate = f"{1 / ours:.0f} experiments/s (aim 50), bare nodes {1 / peer:.0f}"
    return [
        Row("one cycle of the graph, 2000 samples, 5 processes, recorded", ours, who, peer,
            "at least 1/2", rate),
        Row("from `experiment` to `signal`, 99th percentile", ours_late, who, peer_late,
            "at least 1/3", f"{CYCLES - SKIPPED} cycles, best of {ROUNDS}"),
    ]  # fmt: skip


def stream(folder: Path, count: int) -> Path:
    """A recording of experiments without drift."""
    machine = load_machine("rotor")
    plant = Plant(machine, experiments=count, seed=1, degradation="none", start_time=1e9)
    with BagWriter(folder / f"stream_{count}", machine=machine.name) as writer:
        for number in range(1, count + 1):
            experiment = plant.experiment(number)
            writer.write("experiment", experiment, experiment.end)
    return folder / f"stream_{count}"


def replay(folder: Path) -> list[Row]:
    """`ldt replay` against the time that the machine took, once as a whole and once its loop."""
    machine = load_machine("rotor")
    taken = REPLAYED * machine.samples * machine.sample_period
    given = stream(folder, REPLAYED)
    fixed = ("--model", "physics", "--threshold", "1000")

    def best(*options: str | Path) -> float:
        times = []
        for turn in range(ROUNDS):
            out = folder / f"replayed_{len(options)}_{turn}"
            began = time.perf_counter()
            subprocess.run(
                [*LDT, "replay", given, "--out", out, *options], check=True, capture_output=True
            )
            times.append(time.perf_counter() - began)
        return min(times)

    note = f"{REPLAYED} experiments of 20 s"
    peer = "the machine itself"
    return [
        Row("`ldt replay`, physics, nothing to learn, from start to exit", best(*fixed), peer,
            taken, "5000", note),
        Row("the same with the default model", best(), peer, taken, "5000", note),
    ]  # fmt: skip


def run() -> list[Row]:
    """All of them."""
    os.environ["ROS_DOMAIN_ID"] = DOMAIN
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        return [start_up(), *cycles(folder), *replay(folder)]
