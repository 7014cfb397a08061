"""A long run of the graph whose nodes are killed at random moments, against the same undisturbed.

python -m tests.soak [--minutes 30] [--every 15] [--seed 1] [--model linear] [--out FOLDER]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import psutil

sys.path.insert(0, str(Path(__file__).parent / "ros"))
from disturbed import differences, killed, nodes

RATE = 20.0  # times real time: an experiment a second
LDT = [sys.executable, "-c", "from ldt_core.cli import main; main()"]


def main() -> int:
    """Run both, kill, compare, and say what came of it."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--every", type=float, default=15.0, help="longest time between kills [s]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--model", default="linear")
    parser.add_argument("--out", type=Path, help="an empty folder for the recordings")
    given = parser.parse_args()
    folder = given.out or Path(tempfile.mkdtemp(prefix="ldt-soak-"))
    folder.mkdir(parents=True, exist_ok=True)
    count = int(given.minutes * 60 * RATE / 20.0)
    common = ["--experiments", str(count), "--model", given.model, "--start-time", "1e9"]
    common += ["--seed", str(given.seed)]
    calm = subprocess.Popen([*LDT, "run", *common, "--bag", folder / "calm", "--json"],
                            stdout=subprocess.PIPE)  # fmt: skip
    began = time.monotonic()
    rough = subprocess.Popen(
        [*LDT, "up", *common, "--bag", folder / "rough", "--json", "--rate", str(RATE)],
        stdout=subprocess.PIPE,
    )
    victims: Counter[str] = Counter()
    memory: list[tuple[float, int]] = []
    for role in killed(rough, sys.maxsize, given.every, given.seed):
        victims[role] += 1
        minutes = (time.monotonic() - began) / 60
        memory.append((minutes, _resident(rough.pid)))
        print(f"{minutes:6.1f} min, kill {victims.total()}: {role}", file=sys.stderr, flush=True)
    output, _ = rough.communicate()
    calm.communicate()
    (run,) = json.loads(output)["runs"] if output else [{"notes": ["the run gave up"]}]
    lost = differences(folder / "calm", folder / "rough")
    print(f"{count} experiments in {(time.monotonic() - began) / 60:.1f} min; recordings: {folder}")
    print(f"kills: {victims.total()} ({', '.join(f'{r} {n}' for r, n in victims.most_common())})")
    print(f"exit code {rough.returncode}; {'; '.join(run['notes'])}")
    tenth = max(len(memory) // 10, 1)
    first, last = (max(m for _, m in part) for part in (memory[:tenth], memory[-tenth:]))
    print(f"memory of all nodes, most in the first and last tenth: {first} and {last} MB")
    print(f"lost, doubled or other, of all records: {lost or 'none'}")
    return 1 if lost or rough.returncode else 0


def _resident(launcher: int) -> int:
    """Resident memory of the nodes that live [MB]."""
    total = 0
    for process in nodes(launcher).values():
        try:
            total += process.memory_info().rss
        except psutil.Error:
            continue
    return total // 1_000_000


if __name__ == "__main__":
    sys.exit(main())
