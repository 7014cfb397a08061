"""How long a node takes to be where its recording ends, by the length of that, as a table.

python -m tests.benchmarks.restart [EXPERIMENTS ...] [--everything] [--keep]

Time of the processor and most memory of a process of its own: for the detector's state, the
adaptor's (model in force, S_w), the twin's and the recorder's. The experiments have 2000 samples
each, and every tenth brings a new model; each step has chunks of its own, as of a machine that
takes its time, in files of 25 MB. With --everything as without checkpoints: all of it is read.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ldt_core.base.experiment import Action, Adaptation, Experiment, Prediction
from ldt_core.base.settings import resolve
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.writer import BagWriter
from ldt_core.restart.recorded_run import END, RecordedRun
from ldt_core.restart.stage_restart import StageRestart
from ldt_core.twin.loop import Twin
from tests.benchmarks.measured_table import MeasuredTable

COUNTS = (250, 2_050, 20_050)  # half-way between two checkpoints
SAMPLES, LEARNED_EVERY = 2000, 10
SPLIT = 25.0  # MB
MACHINE = load_machine("rotor")
GIVEN = resolve({"model": "physics", "detector": "lddm"})
STAGES = ("detector", "adaptor")


def write(folder: Path, count: int) -> None:
    """A run of so many experiments, and the checkpoints that it would have kept."""
    twin = Twin.from_settings(MACHINE, GIVEN)
    untrained = twin.model.record()
    restarts = [_restart(twin, folder, GIVEN["checkpoint_every"], s) for s in STAGES]
    noise = np.random.default_rng(0)
    rows = noise.uniform(0, 20, (8, 2, SAMPLES)).round(2)  # packs like what a sensor measures
    with BagWriter(folder, "rotor", split_size=SPLIT) as bag:
        bag.write("model", untrained, 1e9)
        version = 0
        for number in range(1, count + 1):
            voltage, speed = rows[number % len(rows)]
            one = Experiment(number, 1e9 + 20 * number, MACHINE.sample_period, voltage, speed)
            said = Prediction(number, one.start, one.period, version, speed)
            signal = twin.detector.step(one, said)
            told = Adaptation(number, Action.KEPT, version, "made up")
            for topic, record in (("experiment", one), ("prediction", said),
                                  ("original_prediction", said), ("signal", signal)):  # fmt: skip
                bag.write(topic, record, one.end)
            if number % LEARNED_EVERY == 0:
                version += 1
                record = type(untrained)(version, untrained.kind, (number,), untrained.parameters)
                bag.write("model", record, one.end)
                told = Adaptation(number, Action.ADAPTED, version, "made up")
                twin.adaptor._adopt(type(twin.model).from_record(record, MACHINE))
            bag.write("adaptation", told, one.end)
            twin.adaptor.memory.remember(one)
            bag.flush()
            for restart in restarts:
                restart.passed(one)


def _restart(twin: Twin, folder: Path, every: int, role: str) -> StageRestart:
    given = {**GIVEN, "checkpoint_every": every}
    return StageRestart(twin.stages[role], role, RecordedRun(folder, "", MACHINE), given, print)


def stage(folder: Path, every: int, name: str) -> int:
    """What a stage's node does when it is started again; steps recalled."""
    restart = _restart(Twin.from_settings(MACHINE, GIVEN), folder, every, name)
    known = restart.return_to_checkpoint()
    recalled = 0
    for step in restart.run.steps(known):
        if not restart.covers(step):
            restart.recall(step)
            recalled += 1
    return recalled


def detector(folder: Path, every: int) -> int:
    """Its detector's state."""
    return stage(folder, every, "detector")


def adaptor(folder: Path, every: int) -> int:
    """Its model and its memory."""
    return stage(folder, every, "adaptor")


def twin(folder: Path, every: int) -> int:
    """The last experiments, and the model in force."""
    return sum(1 for _ in RecordedRun(folder, "", MACHINE).steps(END if every else 0))


def recorder(folder: Path, every: int) -> int:
    """Which experiments and models it has."""
    with BagWriter(folder, "rotor", split_size=SPLIT, resume=True, once=True) as bag:
        return len(bag.recorded("experiment"))


def measured(work: Callable[..., Any], *arguments: Any) -> tuple[float, float, Any]:
    """(processor's time [s], most memory [MB], result) in a process of its own."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_measured, (work, arguments))


def _measured(work: Callable[..., Any], arguments: Any) -> tuple[float, float, Any]:
    begin = time.process_time()
    result = work(*arguments)
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
    return time.process_time() - begin, most, result


def main() -> int:
    """Measure and print, and keep the table if asked to."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.restart")
    parser.add_argument("counts", nargs="*", type=int, default=COUNTS)
    parser.add_argument("--everything", action="store_true")
    parser.add_argument("--keep", action="store_true", help="take them into the page's table")
    given = parser.parse_args()
    every = 0 if given.everything else GIVEN["checkpoint_every"]
    name, option = ("restart all", " --everything") if given.everything else ("restart", "")
    head = ("experiments", "recording", "node", "steps read", "processor time", "peak memory")
    table = MeasuredTable(
        name, f"python -m tests.benchmarks.restart{option}", *head, page="promises"
    )
    for count in given.counts:
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "run"
            write(folder, count)
            size = sum(f.stat().st_size for f in folder.glob("*.mcap")) / 1e6
            for work in (detector, adaptor, twin, recorder):
                seconds, most, result = measured(work, folder, every)
                figures = (f"{size:.0f} MB", work.__name__, result)
                table.add(f"{count:,}", *figures, f"{seconds:.2f} s", f"{most:.0f} MB")
    if given.keep:
        table.keep()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
