"""What a listener that is stopped costs a graph, and what a message of 100 MB does to each node.

python -m tests.stalled [--experiments 100] [--runs 3]
"""

from __future__ import annotations

import argparse
import array
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from ldt_core.recording.bag import read_bag
from tests.programs import LDT

ROS = Path(__file__).parent / "ros"
LARGE = 100_000_000  # bytes
GRAPH = ("--model", "physics", "--seed", "3", "--start-time", "1e9", "--json")


def main() -> int:
    """Measure both and print what came of it."""
    parser = argparse.ArgumentParser(prog="python -m tests.stalled", description=__doc__)
    parser.add_argument("--experiments", type=int, default=100)
    parser.add_argument("--runs", type=int, default=3, help="of each, in turn; the best counts")
    given = parser.parse_args()
    best: dict[bool, float] = {}
    for _ in range(given.runs):
        for stalled in (False, True):
            took = _run(given.experiments, stalled)
            best[stalled] = min(took, best.get(stalled, took))
    alone, beside = (1000 * best[s] / (given.experiments - 1) for s in (False, True))
    print(f"an experiment: {alone:.1f} ms, beside a stopped listener to all topics {beside:.1f} ms")
    _large()
    return 0


def _run(count: int, stalled: bool) -> float:
    """Time from the first adaptation of a run of the graph to the last [s]."""
    with tempfile.TemporaryDirectory(prefix="ldt-stalled-") as folder:
        command = [*LDT, "up", *GRAPH, "--experiments", str(count), "--bag", f"{folder}/run"]
        ear = None
        if stalled:
            code = [sys.executable, str(ROS / "stalled.py")]
            ear = subprocess.Popen(code, stdout=subprocess.PIPE, text=True)
            assert ear.stdout is not None
            ear.stdout.readline()
        graph = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            if ear is not None and ear.stdout is not None:
                ear.stdout.readline()  # it has met them
                ear.send_signal(signal.SIGSTOP)
            output, _ = graph.communicate()
        finally:
            if ear is not None:
                ear.kill()
                ear.wait()
        (told,) = json.loads(output)["runs"]
        if told["notes"] or told["experiments"] != count:
            raise SystemExit(f"{told['experiments']} of {count} experiments; {told['notes']}")
        times = [raw.time_ns for raw in read_bag(f"{folder}/run").storage.picked(["/adaptation"])]
        return (times[-1] - times[0]) / 1e9


def _large() -> None:
    sys.path.insert(0, str(ROS))
    from ldt_ros.graph.environment import prepare

    prepare()
    from stranger import Stranger, experiment

    from ldt_ros.graph.process import ROLES, node_class
    from ldt_ros.nodes.interfaces import to_message

    stranger = Stranger()
    with tempfile.TemporaryDirectory(prefix="ldt-stalled-") as folder:
        given = {"model": "physics"}
        roles = [r for r in ROLES if r not in ("plant", "player", "segmenter", "recorder")]
        nodes = [stranger.start(node_class(role), **given) for role in roles]
        recorder = stranger.start(node_class("recorder"), bag=f"{folder}/bag")
        message = to_message(experiment(1))
        message.data = array.array("d", bytes(LARGE))
        publisher = stranger.publisher("experiment")
        began = time.monotonic()
        publisher.publish(message)
        stranger.until(lambda: all(sum(n.rejected.values()) == 1 for n in nodes))
        stranger.until(lambda: recorder.counts["experiment"] and not len(recorder.backlog))
        took = time.monotonic() - began
        stranger.listen("adaptation")
        publisher.publish(to_message(experiment(2)))
        stranger.until(lambda: stranger.numbers("adaptation") == [2])
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1000
        print(
            f"100 MB to {len(nodes) + 1} nodes: refused by all in {took:.1f} s, recorded; ", end=""
        )
        print(f"the next was dealt with; {memory} MB at most in the one process")
        sys.stdout.flush()
        os._exit(0)


if __name__ == "__main__":
    sys.exit(main())
