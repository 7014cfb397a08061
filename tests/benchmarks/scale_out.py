"""How studies, tuning and diagnoses of many recordings scale with the workers of a Dask cluster.

python -m tests.benchmarks.scale_out [1 2 4] [--recordings 8] [--only tune] [--keep]

Each work is done by the command that a user types, in this machine's own processes and then by a
scheduler and so many workers beside it; what comes out is compared byte for byte. More workers than
there are cores show what the cluster itself costs.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from distributed import LocalCluster

from ldt_core.base.sentences import counted
from tests.benchmarks.measured_table import MeasuredTable
from tests.programs import LDT

EFFECT = "coulomb_friction:torque=0.05"
TIMES = ("seconds", "time", "cpu")  # keys whose values are never the same twice


def main() -> int:
    """Measure, compare, and print a table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.scale_out")
    parser.add_argument("workers", nargs="*", type=int, default=[1, 2, 4])
    parser.add_argument("--recordings", type=int, default=8)
    parser.add_argument("--only", choices=("diagnose", "tune", "study"), action="append")
    parser.add_argument("--keep", action="store_true", help="take them into the page's table")
    given = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="ldt-scale-"))
    bags = [_recorded(folder, n) for n in range(1, given.recordings + 1)]
    works = {
        f"{len(bags)} diagnoses": ["diagnose", *bags, "--each"],
        "tuning": ["tune", bags[0], "--model", "linear", "--order", "1", "--adaptations", "6"],
        "study of 2 seeds": ["study", "--quick", "--only", "paper"],
    }
    works = {n: c for n, c in works.items() if c[0] in (given.only or c)}
    head = ("work", "one process", *(counted(n, "worker") for n in given.workers), "results")
    table = MeasuredTable("cluster", "python -m tests.benchmarks.scale_out", *head)
    for name, command in works.items():
        alone, first = _timed(command, folder / name / "alone", ["--jobs", "1"])
        row, same = [name, f"{alone:.1f} s"], True
        for count in given.workers:
            with _cluster(count) as address:
                place = folder / name / str(count)
                spent, found = _timed(command, place, ["--scheduler", address])
            row.append(f"{spent:.1f} s ({alone / spent:.2f})")
            same = same and found == first
        table.add(*row, "identical" if same else "DIFFERENT")
    if given.keep:
        table.keep()
    return 0


def _recorded(folder: Path, seed: int) -> str:
    bag = str(folder / f"machine_{seed}")
    options = ["--experiments", "12", "--effect", EFFECT, "--seed", str(seed), "--out", bag]
    subprocess.run([*LDT, "simulate", *options], check=True, stdout=subprocess.DEVNULL)
    return bag


@contextlib.contextmanager
def _cluster(workers: int) -> Iterator[str]:
    with LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        dashboard_address=None,
        worker_dashboard_address=None,
    ) as cluster:
        yield cluster.scheduler_address


def _timed(command: list[str], out: Path, where: list[str]) -> tuple[float, dict[str, str]]:
    """Seconds that the command took, and digests of the numbers that it wrote."""
    begin = time.monotonic()
    full = [*LDT, *command, "--out", str(out), *where]
    subprocess.run(full, check=True, stdout=subprocess.DEVNULL)
    spent = time.monotonic() - begin
    return spent, {
        str(file.relative_to(out)): hashlib.sha256(_plain(file)).hexdigest()
        for file in sorted(out.rglob("*.json"))
        if ".run." not in file.name
    }


def _plain(file: Path) -> bytes:
    def without(value: object) -> object:
        if isinstance(value, dict):
            return {k: without(v) for k, v in value.items() if k not in TIMES}
        return [without(v) for v in value] if isinstance(value, list) else value

    return json.dumps(without(json.loads(file.read_text())), sort_keys=True).encode()


if __name__ == "__main__":
    sys.exit(main())
