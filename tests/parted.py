"""A graph on two hosts that are parted while it runs, against the same undisturbed.

python -m tests.parted [--by peers|server] [--after 8] [--seconds 12] [--experiments 40] [--rate 40]
                       [--model linear] [--out FOLDER]

Needs the command ip and root: the hosts are network namespaces. The plant is on one of them, twin,
detector, adaptor and recorder on the other.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "ros"))
from cut_off import PROFILE, SERVED, run_cut, server
from disturbed import differences
from network import two_hosts

from ldt_core.recording.bag import read_bag
from ldt_core.recording.health import inspect
from tests.programs import LDT, Programs

SEED = 3


def main() -> int:
    """Run both, compare, and say what came of it."""
    parser = argparse.ArgumentParser(prog="python -m tests.parted", description=__doc__)
    parser.add_argument("--by", choices=("peers", "server"), default="peers", help="how they meet")
    parser.add_argument("--after", type=int, default=8, help="parted after so many experiments")
    parser.add_argument("--seconds", type=float, default=12.0, help="for so long")
    parser.add_argument("--experiments", type=int, default=40)
    parser.add_argument("--rate", type=float, default=40.0, help="times real time")
    parser.add_argument("--model", default="linear")
    parser.add_argument("--out", type=Path, help="an empty folder for the recordings")
    given = parser.parse_args()
    folder = given.out or Path(tempfile.mkdtemp(prefix="ldt-parted-"))
    folder.mkdir(parents=True, exist_ok=True)
    common = ["--experiments", str(given.experiments), "--model", given.model]
    common += ["--seed", str(SEED), "--start-time", "1e9", "--bag", folder / "calm"]
    subprocess.run([*LDT, "run", *common, "--json"], stdout=subprocess.DEVNULL, check=True)
    settings = {"experiments": given.experiments, "model": given.model, "seed": SEED}
    settings |= {"start_time": 1e9, "rate": f"'{given.rate:g}'"}
    os.environ.setdefault("ROS_LOG_DIR", str(folder / "log"))
    began = time.monotonic()
    with two_hosts() as hosts, Programs() as programs:
        served = given.by == "server"
        environment = server(hosts[0], programs.start) if served else {}
        profile = SERVED if served else PROFILE
        cut = (given.after, given.seconds)
        run_cut(hosts, programs.start, folder, profile, environment, settings, cut)
    seconds = time.monotonic() - began
    told = {s.role: s for s in inspect(read_bag(folder / "rough")).nodes.values()}
    twin = told["twin"]
    lost = differences(folder / "calm", folder / "rough")
    print(f"{given.experiments} experiments in {seconds:.0f} s, parted for {given.seconds:g} s")
    print(f"lost, doubled or other, of all records: {lost or 'none'}")
    counts = ", ".join(f"{n} {twin.number(n)}" for n in ("missing", "repeated", "dropped"))
    print(f"the twin: {counts}; {twin.message}; recordings: {folder}")
    missing = twin.number("missing")
    gone = lost.get("experiment", "0 lost").partition(" lost")[0]
    return 0 if gone == str(missing) and bool(lost) == bool(missing) else 1


if __name__ == "__main__":
    sys.exit(main())
