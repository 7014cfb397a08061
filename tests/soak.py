"""A long run of the graph with faults at random moments, against the same undisturbed.

python -m tests.soak [--minutes 30] [--every 12] [--seed 1] [--model linear] [--only kill]
    [--out FOLDER]

Most faults are a node that is killed. Others: the server that nodes are forked from is killed; a
node is stopped for up to 5 s; all cores are busy with something else for up to 10 s; a stranger
sends what nobody can use, and an experiment once more.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import psutil

sys.path.insert(0, str(Path(__file__).parent / "ros"))
from disturbed import differences, kill, nodes, stall

from tests.programs import LDT

RATE = 20.0  # times real time: an experiment a second
#: How often each fault comes, relative to the others.
SHARES = {"kill": 8, "server": 1, "stall": 3, "load": 1, "stranger": 2}
STALLED = 5.0  # s at most; whoever is stopped for `hung_after` is killed
BUSY = 10.0  # s at most
LATER = 20.0  # s


def main() -> int:
    """Run both, disturb one, compare, and say what came of it."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--every", type=float, default=12.0, help="longest time between faults [s]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--model", default="linear")
    parser.add_argument("--only", choices=SHARES, help="one kind of fault")
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
    done: Counter[str] = Counter()
    memory: list[tuple[float, int]] = []
    faults = Faults(rough, folder / "rough", given.seed, given.only)
    while rough.poll() is None:
        time.sleep(faults.chance.uniform(0.05, given.every))
        if fault := faults.one():
            done[fault] += 1
            minutes = (time.monotonic() - began) / 60
            memory.append((minutes, _resident(rough.pid)))
            told = f"{minutes:6.1f} min, fault {done.total()}: {fault}"
            print(told, file=sys.stderr, flush=True)
    faults.end()
    output, _ = rough.communicate()
    calm.communicate()
    (run,) = json.loads(output)["runs"] if output else [{"notes": ["the run gave up"]}]
    lost = differences(folder / "calm", folder / "rough")
    print(f"{count} experiments in {(time.monotonic() - began) / 60:.1f} min; recordings: {folder}")
    print(f"faults: {done.total()} ({', '.join(f'{f} {n}' for f, n in done.most_common())})")
    print(f"exit code {rough.returncode}; {'; '.join(run['notes'])}")
    tenth = max(len(memory) // 10, 1)
    first, last = (max(m for _, m in part) for part in (memory[:tenth], memory[-tenth:]))
    print(f"memory of all nodes, most in the first and last tenth: {first} and {last} MB")
    print(f"lost, doubled or other, of all records: {lost or 'none'}")
    return 1 if lost or rough.returncode else 0


class Faults:
    """What happens to a run of the graph.

    Args:
        launcher: `ldt up`.
        recording: that it writes.
        seed: of what happens when.
        only: the one kind that does, None for all.
    """

    def __init__(
        self, launcher: subprocess.Popen[bytes], recording: Path, seed: int, only: str | None
    ) -> None:
        self.launcher, self.recording = launcher, recording
        self._shares = {only: 1} if only else SHARES
        self.chance = random.Random(seed)
        self._others: list[subprocess.Popen[bytes]] = []
        self._began = time.monotonic()

    def one(self) -> str:
        """Let one happen; what it was, "" where it could not."""
        (kind,) = self.chance.choices(list(self._shares), list(self._shares.values()))
        found: str = getattr(self, f"_{kind}")()
        self._others = [o for o in self._others if o.poll() is None]
        return found

    def end(self) -> None:
        """End what these faults began."""
        for other in self._others:
            other.terminate()
            other.wait()

    def _kill(self) -> str:
        role = kill(self.launcher.pid, self.chance)
        return f"{role} killed" if role else ""

    def _server(self) -> str:
        with contextlib.suppress(psutil.Error):
            for process in psutil.Process(self.launcher.pid).children():
                if "ldt_ros.graph.fork_server" in process.cmdline():
                    process.kill()
                    return "fork server killed"
        return ""

    def _stall(self) -> str:
        role = stall(self.launcher.pid, self.chance, STALLED)
        return f"{role} stopped for a while" if role else ""

    def _load(self) -> str:
        seconds = self.chance.uniform(1.0, BUSY)
        work = f"import time\nend = time.time() + {seconds}\nwhile time.time() < end: pass"
        for _ in range(psutil.cpu_count() or 1):
            self._others.append(subprocess.Popen([sys.executable, "-c", work]))
        return "all cores busy"

    def _stranger(self) -> str:
        # Another graph that starts at the same moment is refused; this one comes later.
        if time.monotonic() - self._began < LATER:
            return ""
        words = [
            "-m",
            "tests.meddler",
            str(self.recording),
            "--seed",
            str(self.chance.random())[2:8],
        ]
        self._others.append(subprocess.Popen([sys.executable, *words]))
        return "a stranger's messages"


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
