"""What each additional machine costs in one graph: processor time, memory, latency, start-up.

python -m tests.fleet [1 5 20 50] [--experiments 20] [--every SECONDS] [--keep]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil

from ldt_core.recording.bag import read_bag
from tests.benchmarks.measured_table import MeasuredTable
from tests.programs import LDT

LENGTH = 20.0  # s, of an experiment of 2000 samples
HEAD = (
    *("machines", "processor time per experiment", "memory per machine", "latency, median"),
    *("99th percentile", "start-up"),
)


def main() -> int:
    """Measure each size, and print a table."""
    parser = argparse.ArgumentParser(prog="python -m tests.fleet", description=__doc__)
    parser.add_argument("sizes", nargs="*", type=int, default=[1, 5, 20, 50])
    parser.add_argument("--experiments", type=int, default=20, help="of each machine")
    parser.add_argument("--every", type=float, default=1.0, help="s between two of a machine")
    parser.add_argument("--keep", action="store_true", help="take them into the page's table")
    given = parser.parse_args()
    print(
        f"{os.cpu_count()} cores; one experiment of 2000 samples per machine and {given.every:g} s"
    )
    table = MeasuredTable("fleet", "python -m tests.fleet", *HEAD)
    for size in given.sizes:
        table.add(*_measured(size, given.experiments, given.every))
    if given.keep:
        table.keep()
    return 0


def _measured(machines: int, experiments: int, every: float) -> tuple[str, ...]:
    folder = Path(tempfile.mkdtemp(prefix="ldt-fleet-"))
    began = time.time()
    graph = subprocess.Popen(
        [*LDT, "up", "--machines", str(machines), "--experiments", str(experiments), "--model",
         "physics", "--detector", "adequacy", "--rate", str(LENGTH / every),
         "--bag", folder / "fleet"],
        stdout=subprocess.DEVNULL,
    )  # fmt: skip
    used: dict[int, float] = {}
    resident: list[int] = [0]
    while graph.poll() is None:
        time.sleep(0.2)
        now = 0
        for process in _children(graph.pid):
            try:
                spent = process.cpu_times()
                used[process.pid] = spent.user + spent.system
                now += process.memory_full_info().pss  # pages that are shared count once
            except psutil.Error:
                continue
        resident.append(now)
    if graph.returncode:
        sys.exit(f"the graph of {machines} machines ended with code {graph.returncode}")
    latencies, first = [], []
    for k in range(machines):
        name = f"machine_{k + 1}" if machines > 1 else ""
        bag = read_bag(folder / "fleet" / name if name else folder / "fleet")
        sent = {r.number: t for r, t in _timed(bag, "experiment")}
        done = {r.experiment: t for r, t in _timed(bag, "adaptation")}
        latencies += [done[n] - sent[n] for n in sent.keys() & done.keys()]
        first.append(min(sent.values()))
    per = sum(used.values()) / machines
    often = "" if every == 1 else f", one experiment every {every:g} s"
    return (
        f"{machines} ({_shared(machines, len(used))}){often}",
        f"{per / experiments * 1e3:.0f} ms",
        f"{max(resident) / machines / 1e6:.0f} MB",
        f"{np.median(latencies) * 1e3:.1f} ms",
        f"{np.quantile(latencies, 0.99) * 1e3:.1f} ms",
        f"{max(first) - began - every:.1f} s",
    )


def _shared(machines: int, processes: int) -> str:
    return f"{processes} processes" if machines == 1 else f"{machines / processes:.0f} per process"


def _timed(bag, name):
    raws = bag.messages(name)
    return ((r, raw.time_ns / 1e9) for r, raw in zip(bag.records(name), raws, strict=True))


def _children(launcher: int) -> list[psutil.Process]:
    try:
        return psutil.Process(launcher).children()
    except psutil.Error:
        return []


if __name__ == "__main__":
    sys.exit(main())
