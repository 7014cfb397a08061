"""A stranger floods a running graph with experiments that could be the machine's.

python -m tests.flood [--seconds 60]

It publishes them as fast as it can, beside a run of `ldt up`. Said is how many there were, the most
memory that each node took, and what the run said of it. In a ROS domain of its own.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent / "ros"))
from disturbed import LDT, nodes, wait_for

DOMAIN = "97"
LENGTH, PERIOD = 2000, 0.01  # samples, s
EXPERIMENTS, RATE = 60, 10  # of the run, times real time: two minutes
BEHIND = 6  # experiments after which a second publisher no longer refuses the run, but is told of
FIRST = 1000  # number of the stranger's first one


def flood(seconds: float) -> int:
    """Publish for so long; how many there were."""
    import rclpy

    from ldt_core.base.experiment import Experiment
    from ldt_ros.nodes.interfaces import message_type, qos, to_message

    rclpy.init()
    node = rclpy.create_node("flood")
    publisher = node.create_publisher(message_type("experiment"), "experiment", qos("experiment"))
    time.sleep(2.0)  # to be met by all
    chance, number, end = np.random.default_rng(0), FIRST, time.monotonic() + seconds
    volts = np.full(LENGTH, 10.0)
    while time.monotonic() < end:
        number += 1
        speed = chance.normal(size=LENGTH)
        one = Experiment(number, 1.7e9 + LENGTH * PERIOD * number, PERIOD, volts, speed)
        publisher.publish(to_message(one))
    node.destroy_node()
    rclpy.shutdown()
    return number - FIRST


def main() -> int:
    """Run, flood, and say what came of it; 1 where a node crashed or the run did not end."""
    parser = argparse.ArgumentParser(prog="python -m tests.flood", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--send", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.send:
        print(flood(given.seconds))
        return 0
    os.environ["ROS_DOMAIN_ID"] = DOMAIN
    folder = Path(tempfile.mkdtemp(prefix="ldt-flood-"))
    how = ["--experiments", str(EXPERIMENTS), "--rate", str(RATE), "--model", "linear", "--json"]
    run = subprocess.Popen(
        [LDT, "up", *how, "--bag", folder / "run"], stdout=subprocess.PIPE, text=True
    )
    wait_for(folder / "run", BEHIND)
    sender = [sys.executable, "-m", "tests.flood", "--send", "--seconds", str(given.seconds)]
    stranger = subprocess.Popen(sender, stdout=subprocess.PIPE, text=True)
    most: Counter[str] = Counter()
    while stranger.poll() is None:
        for role, process in nodes(run.pid).items():
            most[role] = max(most[role], process.memory_info().rss // 10**6)
        time.sleep(0.5)
    output, _ = run.communicate(timeout=600)
    notes = json.loads(output)["runs"][0]["notes"]
    print(f"{(stranger.communicate()[0]).strip()} experiments in {given.seconds:g} s")
    print(f"most memory [MB]: {dict(most)}; exit code {run.returncode}; {'; '.join(notes)}")
    return int(run.returncode not in (0, 1) or any("crashed" in note for note in notes))


if __name__ == "__main__":
    sys.exit(main())
