"""How long the loop takes while a diagnosis is made beside it, by a recording's own clock.

`ldt up` with the model that asks for diagnoses, at a given pace; from the time at which the
recorder heard an `experiment` to that at which it heard its `adaptation`.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ldt_core.recording.bag import Bag, read_bag
from ldt_core.recording.message_subject import number_of
from tests.benchmarks.row import Row
from tests.programs import LDT

EXPERIMENTS = 20
#: Of real time: an experiment of 20 s every so many seconds.
RATE = float(os.environ.get("LDT_BENCHMARK_RATE", "1"))
DOMAIN = "230"  # ours alone
LIMIT = 1.0  # s, aimed at


def latencies(bag: Bag) -> dict[int, float]:
    """By experiment: from its message to that of its adaptation [s]."""
    heard: dict[str, dict[int, float]] = {"experiment": {}, "adaptation": {}}
    for raw in bag.messages(*heard):
        number = number_of(raw.topic, raw.kind, raw.data)
        if number is not None:
            heard[raw.topic.rpartition("/")[2]].setdefault(number, raw.time_ns * 1e-9)
    answered = heard["adaptation"]
    return {n: answered[n] - sent for n, sent in heard["experiment"].items() if n in answered}


def under_way(bag: Bag) -> set[int]:
    """Experiments after one that asked for a diagnosis, up to that at which it takes part."""
    found: set[int] = set()
    for record in bag.records("diagnosis"):
        found |= set(range(int(str(record.values["asked_at"])) + 1, record.experiment + 1))
    return found


def run() -> Iterator[Row]:
    """A wearing rotor, experiments at the pace."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "run"
        command = [*LDT, "up", "--model", "diagnosed", "--cause", "auto", "--seed", "3"]
        command += ["--experiments", str(EXPERIMENTS), "--rate", f"{RATE:g}", "--bag", str(folder)]
        environment = {**os.environ, "ROS_DOMAIN_ID": DOMAIN}
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
        bag = read_bag(folder)
        took, during = latencies(bag), under_way(bag)
        times = [took[n] for n in sorted(during & took.keys())]
        asked = len(list(bag.records("diagnosis")))
    for share, what in ((0.5, "median"), (0.99, "99th percentile")):
        yield Row(
            f"`experiment` to `adaptation` during a diagnosis, {what}",
            float(np.quantile(times, share)),
            "the limit",
            LIMIT,
            "at least 1",
            f"{len(times)} of {len(took)} experiments, {asked} diagnoses, {RATE:g} times real "
            "time; "
            f"of all experiments {np.quantile(list(took.values()), share):.3g} s",
        )
