"""Memory and speed of a long recording, written, read back and shown, as a table.

python -m tests.benchmarks.long_recording [--keep] [EXPERIMENTS]

Short experiments at full speed, with all that a run records of each, in files of 50 MB. Writing,
reading, the recording's health and each way to show it have a process of their own. Seconds are
those of the processor, which a busy machine does not stretch.
"""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from ldt_core.base.experiment import Action, Adaptation, Experiment, Level, Prediction, Signal
from ldt_core.doctor.recording_checks import findings
from ldt_core.recording.bag import read_bag
from ldt_core.recording.health import inspect
from ldt_core.recording.writer import BagWriter
from ldt_core.views.figures.run_figure import load_run, plot_run
from ldt_core.views.report.report_page import write_run_page
from ldt_core.views.watch.fleet import Fleet
from ldt_core.views.watch.record_source import Playback
from tests.benchmarks.measured_table import MeasuredTable

EXPERIMENTS, SAMPLES, PERIOD = 100_000, 100, 0.01
SPLIT = 50.0  # MB
SHARES = (0.1, 0.5, 1.0)  # of the experiments, at which memory is looked at


def resident() -> float:
    """Memory of this process that is in the machine's [MB]."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1000
    raise RuntimeError("no VmRSS")


def write(folder: Path, count: int) -> Iterator[int]:
    """Write everything that a run records; gives each number when it is written."""
    noise = np.random.default_rng(0)
    with BagWriter(folder, "rotor", split_size=SPLIT) as bag:
        for number in range(1, count + 1):
            voltage, speed, guess = noise.normal(size=(3, SAMPLES))
            one = Experiment(number, 1e9 + number, PERIOD, voltage, speed)
            said = Prediction(number, one.start, PERIOD, 0, guess)
            bag.write("experiment", one, one.end)
            bag.write("prediction", said, one.end)
            bag.write("original_prediction", said, one.end)
            signal = Signal(number, Level.NEGATIVE, "threshold", 0, 0.5, {"threshold": 3.0})
            bag.write("signal", signal, one.end)
            done = Adaptation(number, Action.KEPT, 0, "the prediction holds", {"memory": 0.0})
            bag.write("adaptation", done, one.end)
            yield number


def read(folder: Path, count: int) -> Iterator[int]:
    """Read and check the experiments."""
    for experiment in read_bag(folder).experiments():
        yield experiment.number


def resume(folder: Path, count: int) -> Iterator[int]:
    """Resume the run, to write more; all experiments are known then."""
    with BagWriter(folder, "rotor", split_size=SPLIT, resume=True) as bag:
        yield len(bag.recorded("experiment"))


def examine(folder: Path, count: int) -> Iterator[int]:
    """Check it, as `ldt doctor` does."""
    health = inspect(read_bag(folder))
    assert not health.notes, findings(health)
    yield len(health.numbers)


def show(folder: Path, count: int) -> Iterator[int]:
    """Make the page of `ldt report`."""
    run = write_run_page(folder, folder.with_suffix(".html"))
    yield len(run.steps)


def draw(folder: Path, count: int) -> Iterator[int]:
    """Draw the figure of `ldt plot`."""
    run = load_run(folder)
    plot_run(run, folder.with_suffix(".png"))
    yield len(run.steps)


def play(folder: Path, count: int) -> Iterator[int]:
    """Play it to its end, as `ldt watch --rate max` does."""
    played = Playback(folder, rate="max")
    played.run(Fleet(live=False), threading.Event(), lambda: None)
    yield played.clock.position


Work = Callable[[Path, int], Iterator[int]]


def measure(work: Work, folder: Path, count: int) -> list[float]:
    """Seconds, then memory before and at each of the shares [MB], in a process of its own."""
    context = multiprocessing.get_context("spawn")
    with context.Pool(1) as pool:
        return pool.apply(_measure, (work, folder, count))


def _measure(work: Work, folder: Path, count: int) -> list[float]:
    looks = [round(share * count) for share in SHARES]
    memory = [resident()]
    begin = time.process_time()
    number = 0
    for number in work(folder, count):
        if number in looks[:-1]:
            memory.append(resident())
    memory.append(resident())  # at the end, all closed
    assert number == count, (number, count)
    return [time.process_time() - begin, *memory]


def main() -> int:
    """Measure and print."""
    given = [text for text in sys.argv[1:] if text != "--keep"]
    count = int(given[0]) if given else EXPERIMENTS
    memory = (*(f"memory at {share:.0%}".replace("%", " %") for share in SHARES[:-1]), "at the end")
    head = (f"{count:,} experiments of {SAMPLES} samples", "processor time", "per second", *memory)
    table = MeasuredTable("recording", "python -m tests.benchmarks.long_recording", *head)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "run"
        for work in (write, read, resume, examine, show, draw, play):
            seconds, _, *looks = measure(work, folder, count)
            shown = [f"{m:.0f} MB" for m in looks]
            shown[:0] = ["-"] * (len(SHARES) - len(shown))
            words = (work.__doc__ or "").partition(";")[0].rstrip(".")
            table.add(words, f"{seconds:.1f} s", f"{count / seconds:,.0f}", *shown)
        size = sum(f.stat().st_size for f in folder.iterdir()) / 1e6
        print(f"\n{len(list(folder.glob('*.mcap')))} files, {size:.0f} MB.")
    if len(given) < len(sys.argv[1:]):
        table.keep()
    return 0


if __name__ == "__main__":
    sys.exit(main())
