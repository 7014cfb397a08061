"""The node graph against nodes that do nothing: start-up, a cycle, latency; and a replay.

The graph is `ldt up` as a user calls it, and everything is timed by a listener beside it. Best of
several rounds in turn, since whatever else the machine does only makes times longer.
"""

from __future__ import annotations

import contextlib
import io
import itertools
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

from ldt_core.cli import invoke
from ldt_core.cli.replay import command
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import BagWriter
from tests.benchmarks.bare_node import ROLES
from tests.benchmarks.ear import Ear
from tests.benchmarks.row import Row, best_of, load_average
from tests.programs import LDT

CYCLES = 500
SKIPPED = 20  # cycles of warming up
RATE = 50  # experiments a second that the graph is to manage at least
REPLAYED = 200
ROUNDS = 5
DOMAIN = "231"  # ours alone: the last but one that the ports allow
BARE = [sys.executable, "-m", "tests.benchmarks.bare_node"]


@contextlib.contextmanager
def running(*commands: Sequence[str | Path]) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Programs, ended at the end: ours as by Ctrl-C, bare nodes by force."""
    programs = [subprocess.Popen(c, stdout=subprocess.DEVNULL) for c in commands]
    try:
        yield programs
    finally:
        for program, words in zip(programs, commands, strict=True):
            program.send_signal(signal.SIGINT if "up" in words else signal.SIGKILL)
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
            for command, times in ((graph(), ours), ([*BARE, "lone"], bare)):
                ear.clear()
                began = time.perf_counter()
                with running(command) as (program,):
                    ear.until(lambda: bool(ear.heard["experiment"]))
                    times.append(ear.heard["experiment"][0] - began)
                    if times is ours:
                        used.append(memory(program.pid))
    return Row(
        "start-up of the whole graph: from `ldt up` to the first `experiment`",
        min(ours),
        "a bare rclpy node: from the start of Python to the first message",
        min(bare),
        "at least 1/3",
        f"launcher and 5 nodes use {statistics.median(used):.0f} MB; best of {ROUNDS}",
    )


def graph() -> list[str | Path]:
    """The command of an endless run, with the default model and detector."""
    folder = Path(tempfile.mkdtemp(prefix="ldt-benchmark-"))
    return [*LDT, "up", "--experiments", "1000000", "--bag", folder / "run"]


def cycles(folder: Path) -> list[Row]:
    """Of experiments without drift: from sample in to signal out, and the whole cycle.

    The benchmark is the machine: it sends an experiment and waits for what comes of it.
    """
    from ldt_ros.nodes.interfaces import message_type, qos, to_message

    messages = [to_message(e) for e in read_bag(stream(folder / "sent", CYCLES)).experiments()]
    bare = [[*BARE, role] for role in ROLES]
    found: dict[tuple[str, str, float], list[list[float]]] = {}
    with Ear("signal", "adaptation") as ear:
        publisher = ear.node.create_publisher(
            message_type("experiment"), "experiment", qos("experiment")
        )
        for turn, period in itertools.product(range(ROUNDS), (0.0, 1 / RATE)):
            nodes = [_node(role, folder / f"run_{turn}_{period}") for role in ROLES]
            for name, commands in (("ours", nodes), ("bare", bare)):
                ear.clear()
                with running(*commands):
                    took = ear.exchange(publisher, len(ROLES), messages, period)
                for topic, times in took.items():
                    found.setdefault((name, topic, period), []).append(times[SKIPPED:])
    who = "bare rclpy nodes passing the same messages"
    ours, peer = (_least(found[n, "adaptation", 0.0], 0.5) for n in ("ours", "bare"))
    rate = f"{1 / ours:.0f} experiments/s (aim 50), bare nodes {1 / peer:.0f}"
    rows = [Row("one cycle of the graph, 2000 samples, 5 processes, recorded", ours, who, peer,
                "at least 1/2", rate)]  # fmt: skip
    for period, when in ((1 / RATE, f"at {RATE} experiments/s"), (0.0, "at full speed")):
        for share, name in ((0.5, "median"), (0.99, "99th percentile")):
            ours, peer = (_least(found[n, "signal", period], share) for n in ("ours", "bare"))
            what = f"from `experiment` to `signal` {when}, {name}"
            note = f"{CYCLES - SKIPPED} cycles, best of {ROUNDS}; {load_average()}"
            rows.append(Row(what, ours, who, peer, "at least 1/3", note))
    return rows


def _least(rounds: list[list[float]], share: float) -> float:
    """A quantile, in the round in which the rest of the machine disturbed least."""
    return min(float(np.quantile(times, share)) for times in rounds if times)


def _node(role: str, bag: Path) -> list[str | Path]:
    """A node of the graph by itself, of a machine that does not drift."""
    parameters = ("model:=physics", "detector:=never", f"bag:={bag}")
    given = [word for parameter in parameters for word in ("-p", parameter)]
    return [sys.executable, "-m", "ldt_ros.graph.process", "--node", role, "--ros-args", *given]


def stream(recording: Path, count: int) -> Path:
    """A recording of experiments without drift."""
    machine = load_machine("rotor")
    plant = Plant(machine, experiments=count, seed=1, degradation="none", start_time=1e9)
    with BagWriter(recording, machine=machine.name) as writer:
        for number in range(1, count + 1):
            experiment = plant.experiment(number)
            writer.write("experiment", experiment, experiment.end)
    return recording


def replay(folder: Path) -> list[Row]:
    """`ldt replay` against the time that the machine took: its work, and the whole program."""
    machine = load_machine("rotor")
    taken = REPLAYED * machine.samples * machine.sample_period
    given = stream(folder / "given", REPLAYED)
    number = itertools.count()

    def arguments(*options: str) -> list[str]:
        return [str(given), "--out", str(folder / f"replayed_{next(number)}"), "--json", *options]

    def work(*options: str) -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            assert invoke(command, arguments(*options)) == 0

    def program(*options: str) -> None:
        subprocess.run([*LDT, "replay", *arguments(*options)], check=True, capture_output=True)

    fixed = ("--model", "physics", "--detector", "never")
    note, peer, aim = f"{REPLAYED} experiments of 20 s", "the machine itself", "5000"
    return [
        Row("replay, nothing to learn", best_of(ROUNDS, lambda: work(*fixed)), peer, taken, aim,
            note),
        Row("replay with the default model", best_of(ROUNDS, work), peer, taken, aim, note),
        Row("`ldt replay` from the start of the program, nothing to learn",
            best_of(ROUNDS, lambda: program(*fixed)), peer, taken, "", note),
    ]  # fmt: skip


def run() -> list[Row]:
    """All of them."""
    os.environ["ROS_DOMAIN_ID"] = DOMAIN
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        return [start_up(), *cycles(folder), *replay(folder)]
